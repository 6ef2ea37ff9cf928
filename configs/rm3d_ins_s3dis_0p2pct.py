# RM3D, classes and instances of points of S3DIS, from 0.2 % of the points.
# Run: rm3d train rm3d_ins_s3dis_0p2pct [--demo]
# Time: not measured.
# Score on S3DIS: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = './_base_/s3dis.py'
task = 'instances'
budget = '0p2pct'
# Many things have an annotated point here; regions that are named without one would teach classes and no instances.
region_prior = None
