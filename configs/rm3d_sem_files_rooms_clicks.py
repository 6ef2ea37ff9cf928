# RM3D, classes of points of your own scans of rooms, from what you clicked: docs/own_scans.md.
# Run: rm3d train rm3d_sem_files_rooms_clicks --cfg-options data_root=FOLDER budget.clicks=clicks.csv 'class_names=[floor,wall,chair]'
# Time: not measured.
# Score on real rooms: not measured.
_base_ = './_base_/files.py'
budget = dict(clicks='clicks.csv')
voxel_size = 0.05  # m
height_scale = 3.0  # m
descriptor = dict(_delete_=True, type='AdaptedPFH', radius=0.1)
oversegmenter = dict(_delete_=True, type='RegionGrowing', zeta=0.015, max_color_step=0.2)
max_gap = 0.1  # m
