# RM3D, boxes of S3DIS, from 3 % of the boxes.
# Run: rm3d train rm3d_votenet_s3dis_3pct [--demo]
# Time: not measured.
# Score on S3DIS: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = './_base_/s3dis_boxes.py'
budget = '3pct'
