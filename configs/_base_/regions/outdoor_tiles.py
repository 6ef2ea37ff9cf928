# Regions of tiles whose ground is one class.
_base_ = './outdoor.py'
ground_cell = 4.0  # m
