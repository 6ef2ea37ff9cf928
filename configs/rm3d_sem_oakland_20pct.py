# RM3D semantic segmentation of Oakland from 20 % of the points.
# Run: python tools/train.py configs/rm3d_sem_oakland_20pct.py --cfg-options data_root=FOLDER
# Score on Oakland's test tiles: docs/RESULTS.md.
_base_ = ['./_base_/variants/sem_oakland.py', './_base_/budgets/points_20pct.py']
# Things of no class stand in the tiles; with so many points annotated by chance they are those of which none was.
region_prior = dict(missing_points=4.0)
