# Weak baseline: the network and schedule of rm3d_sem_s3dis_onept on the annotated points alone.
# Run: rm3d train sup_sem_s3dis_onept [--demo]
# Time: not measured.
# Score on S3DIS: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = '../_base_/s3dis.py'
budget = 'onept'
label_refreshes = 1  # the first labels stay
propagate = False  # training sees the annotated points alone
