# RM3D, boxes of S3DIS, from one labelled box per ten rooms.
# Run: rm3d train rm3d_votenet_s3dis_0p5pct [--demo]
# Time: not measured.
# Score on S3DIS: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = './_base_/s3dis_boxes.py'
budget = '0p5pct_alike'  # classes take turns; '0p5pct': as they come
