# Full supervision: the network and schedule of rm3d_votenet_s3dis_* on all boxes.
# Run: rm3d train sup_votenet_s3dis_full [--demo]
# Time: not measured.
# Score on S3DIS: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = '../_base_/s3dis_boxes.py'
budget = 'full'
label_refreshes = 1  # the first labels stay
