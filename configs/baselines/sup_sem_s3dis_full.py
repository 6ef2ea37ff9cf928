# Full supervision: the network and schedule of rm3d_sem_s3dis_* on all labels.
# Run: rm3d train sup_sem_s3dis_full [--demo]
# Time: not measured.
# Score on S3DIS: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = '../_base_/s3dis.py'
budget = 'full'
label_refreshes = 1  # the labels stay
propagate = False  # all points have a label
