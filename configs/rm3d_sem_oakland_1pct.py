# RM3D, classes of points of Oakland, from 1 % of the points.
# Run: rm3d train rm3d_sem_oakland_1pct --cfg-options data_root=FOLDER
# Time: not measured.
# Score on the test tiles: docs/RESULTS.md.
_base_ = './_base_/oakland.py'
budget = '1pct'
