# RM3D, classes of points of your own scans from the air, from what you clicked: docs/own_scans.md.
# Run: rm3d train rm3d_sem_files_airborne_clicks --cfg-options data_root=FOLDER budget.clicks=clicks.csv 'class_names=[ground,tree,building]'
# Time: not measured.
# Score on real tiles: not measured.
_base_ = './_base_/files.py'
budget = dict(clicks='clicks.csv')
voxel_size = 0.5  # m
height_scale = 10.0  # m
descriptor = dict(radius=1.5, range_growth=0.0)
region_reach = 1.5  # m
max_gap = 2.0  # m
