# Semantic segmentation of one's own scans, outdoors, from what a person clicked; a leaf names the clicks.
_base_ = [
    '../runtime.py',
    '../datasets/files.py',
    '../models/segmentor_tiles.py',
    '../regions/outdoor.py',
    '../schedules/tiles.py',
]
# Labels that spread within one scan (or a few): each step sees the scan as it lies, whole. It is this very scan that is asked
# for, so nothing is turned, and the network may learn what lies where.
sigma = 20
periods = [20, 40]
learning_rate = 1e-2
gamma = 0.75
voxel_size = 0.4  # m
train_pipeline = [
    dict(type='ShapeFeatures', cache='${cache_dir}'),
    dict(type='LevelGround'),
    dict(type='PackScene'),
]
model = dict(inputs=dict(coordinates=True, extent=30.0))  # m from the middle that count a half
strategy = dict(mixed_regions='nearest')
oversegmenter = dict(rest=dict(min_region=40))
checkpoint_interval = '${sigma}'
