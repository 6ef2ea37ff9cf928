# RM3D, boxes of Waymo, from one labelled box per ten frames.
# Run: rm3d train rm3d_votenet_waymo_0p5pct [--demo]
# Time: not measured.
# Score on Waymo: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = './_base_/waymo.py'
budget = '0p5pct_alike'  # classes take turns; '0p5pct': as they come
