# Regions of tiles whose ground is one class, and a confidence for networks that see rare classes more often than they are.
_base_ = './outdoor.py'
ground_cell = 4.0  # m
gamma = 0.75
strategy = dict(prior_looks='neighbors', inverse_temperature=2.0)
