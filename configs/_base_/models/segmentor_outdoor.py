# The segmentor of the paper for streets: 10 cm voxels; heights above the ground as input, but no places, which say nothing of a
# street and differ between crops and whole scenes.
_base_ = './segmentor_paper.py'
voxel_size = 0.1  # m
class_balance = 'batch'
class_power = 0.8  # weight of a class = labels of it ^ -0.8: wires and poles are a thousandth of the points
height_scale = 5.0  # m of height that count 1; what is twice as high counts as that high
model = dict(inputs=dict(coordinates=False, height_scale='${height_scale}'))
