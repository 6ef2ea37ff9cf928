# RM3D, classes of points of Oakland, from 20 % of the points.
# Run: rm3d train rm3d_sem_oakland_20pct --cfg-options data_root=FOLDER
# Time: not measured.
# Score on the test tiles: docs/RESULTS.md.
_base_ = './_base_/oakland.py'
budget = '20pct'
# Things of no class stand in the tiles; with so many points annotated by chance they are those of which none was.
region_prior = dict(missing_points=4.0)
