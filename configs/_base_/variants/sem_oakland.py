# Semantic segmentation of Oakland; a leaf adds a budget. There are no demo scenes in this format.
_base_ = [
    '../runtime.py',
    '../datasets/oakland.py',
    '../models/segmentor_tiles.py',
    '../regions/outdoor_tiles.py',
    '../schedules/tiles.py',
]
checkpoint_interval = '${sigma}'
point_columns = ['shape', 'clearance']
# The columns are noised, and a step sees a small crop of every tile: one large crop is no sample of them, and the whole tiles
# of the test then look strange to the batch normalisation.
train_pipeline = [
    dict(type='ShapeFeatures', cache='${cache_dir}'),
    dict(type='HeightAboveGround'),
    dict(type='ClearanceFeatures'),
    dict(type='ClassCrop', max_points='${crop_points}'),
    dict(type='GlobalRotScale', rot=[-3.1416, 3.1416], scale=[0.9, 1.1]),
    dict(type='RandomFlipY', prob=0.5),
    dict(type='PointNoise', jitter=0.0, columns=0.05),
    dict(type='AugmentedView', prob='${aug_prob}'),
    dict(type='PackScene'),
]
crop_points = 4000
batch_size = 6
sigma = 160
periods = [160, 320]  # epochs, of one step each
# At test time tiles are read from eight sides, the points of a region speak together, and rare classes are rare.
eval_pipeline = [
    dict(
        type='RegionNumbers',
        cache='${cache_dir}',
        descriptor='${descriptor}',
        oversegmenter='${oversegmenter}',
        graph_neighbors='${graph_neighbors}',
        max_gap='${max_gap}',
    ),
    dict(type='ShapeFeatures', cache='${cache_dir}'),
    dict(type='HeightAboveGround'),
    dict(type='ClearanceFeatures'),
    dict(type='PackScene'),
]
votes = 8
superpoint_smoothing = 0.5
logit_adjustment = 0.2
