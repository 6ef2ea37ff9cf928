# Semantic segmentation of one's own scans, outdoors, from what a person clicked; a leaf names the clicks.
_base_ = [
    '../runtime.py',
    '../datasets/files.py',
    '../models/segmentor_tiles.py',
    '../regions/outdoor.py',
    '../schedules/tiles.py',
]
# Labels spread within one scan (or a few): a step sees it whole, and the network is told where in it a point lies, since it is
# this very scan that is asked for and near points are often alike. `place` stands for a point whatever way the scan is turned.
sigma = 20
periods = [20, 40]
learning_rate = 1e-2
class_power = 0.5
region_prior = dict(gamma=0.75)
voxel_size = 0.4  # m
crop_points = 1000000  # larger scans are learnt and predicted in parts
model = dict(inference=dict(max_points='${crop_points}'))
point_columns = [
    'shape',
    'place',
]  # before them 'intensity', 'rgb', where the scans have both: ['intensity', 'rgb', ...]
train_pipeline = [
    dict(type='ColorJitter'),
    dict(type='ShapeFeatures', cache='${cache_dir}'),
    dict(type='SinusoidalPosition'),
    dict(type='HeightAboveGround'),
    dict(type='ClassCrop', max_points='${crop_points}'),
    dict(type='GlobalRotScale', rot=[-3.1416, 3.1416], scale=[0.9, 1.1]),
    dict(type='RandomFlipY', prob=0.5),
    dict(type='PackScene'),
]
eval_pipeline = [
    dict(type='ShapeFeatures', cache='${cache_dir}'),
    dict(type='SinusoidalPosition'),
    dict(type='HeightAboveGround'),
    dict(type='PackScene'),
]
propagation = dict(_delete_=True)
oversegmenter = dict(rest=dict(min_region=40))
checkpoint_interval = '${sigma}'
