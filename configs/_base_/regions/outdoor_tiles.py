# Regions of tiles whose ground is one class, and a confidence for networks that see rare classes more often than they are.
_base_ = './outdoor.py'
ground_cell = 4.0  # m
region_prior = dict(gamma=0.75, classifier='neighbors', inverse_temperature=2.0)
