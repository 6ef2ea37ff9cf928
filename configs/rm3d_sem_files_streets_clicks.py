# RM3D, classes of points of your own scans of streets (lidar on the ground or on a car), from what you clicked: docs/own_scans.md.
# Run: rm3d train rm3d_sem_files_streets_clicks --cfg-options data_root=FOLDER budget.clicks=clicks.csv 'class_names=[ground,tree,car]'
# Time: not measured.
# Score on single real scans: docs/RESULTS.md.
_base_ = './_base_/files.py'
budget = dict(clicks='clicks.csv')
