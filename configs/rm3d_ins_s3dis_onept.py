# RM3D, classes and instances of points of S3DIS, from one labelled point per class and scene.
# Run: rm3d train rm3d_ins_s3dis_onept [--demo]
# Time: not measured.
# Score on S3DIS: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = './_base_/s3dis.py'
task = 'instances'
budget = 'onept'
# A class has one label a scene: nothing corrects one that propagates too far.
propagation = dict(max_extent=1.75)
