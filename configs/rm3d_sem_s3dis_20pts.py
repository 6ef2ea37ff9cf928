# RM3D, classes of points of S3DIS, from 20 labelled points a scene.
# Run: rm3d train rm3d_sem_s3dis_20pts [--demo]
# Time: not measured.
# Score on S3DIS: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = './_base_/s3dis.py'
budget = '20pts'
