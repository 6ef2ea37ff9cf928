# RM3D, classes and instances of points of S3DIS, from 20 labelled points a scene.
# Run: rm3d train rm3d_ins_s3dis_20pts [--demo]
# Time: not measured.
# Score on S3DIS: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = './_base_/s3dis.py'
task = 'instances'
budget = '20pts'
