# RM3D, classes of points of Oakland, from 0.1 % of the points.
# Run: rm3d train rm3d_sem_oakland_0p1pct --cfg-options data_root=FOLDER
# Time: not measured.
# Score on the test tiles: docs/RESULTS.md.
_base_ = './_base_/oakland.py'
budget = '0p1pct'
