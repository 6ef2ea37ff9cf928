"""Pseudo boxes and the labels of their points."""
