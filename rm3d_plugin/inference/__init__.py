"""Prediction for any scan, and over-segmentation of a file."""

from rm3d_plugin.inference.region_numbers import RegionNumbers

__all__ = ['RegionNumbers']
