# The outdoor segmentor for a handful of tiles and a CPU: five levels, coarse voxels, one view a step.
_base_ = './segmentor_outdoor.py'
voxel_size = 0.3  # m
widths = [16, 32, 48, 64, 80]
blocks = 1
aug_prob = 0.0  # 1: a step costs two thirds more
