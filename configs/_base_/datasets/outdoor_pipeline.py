# Augmentation of streets (METHOD 7), and what prediction sees of them. Heights are above the ground below a point, so slopes
# need not be learnt: the ground is found in the whole scene, before any crop.
_base_ = './points.py'
crop_points = 120000
recent_scenes = 16  # whose shapes and heights stay in memory
train_pipeline = [
    dict(type='ColorAutoContrast'),
    dict(type='ColorJitter'),
    dict(type='ShapeFeatures', cache='${cache_dir}', recent='${recent_scenes}'),
    dict(type='HeightAboveGround', recent='${recent_scenes}'),
    dict(type='ClassCrop', max_points='${crop_points}'),
    dict(type='GlobalRotScale', rot=[-3.1416, 3.1416], scale=[0.9, 1.1]),
    dict(type='RandomFlipY', prob=0.5),
    dict(type='AugmentedView', prob='${aug_prob}'),
    dict(type='PackScene'),
]
eval_pipeline = [
    dict(type='ShapeFeatures', cache='${cache_dir}', recent='${recent_scenes}'),
    dict(type='HeightAboveGround', recent='${recent_scenes}'),
    dict(type='PackScene'),
]
label_dataloader = dict(dataset=dict(pipeline='${eval_pipeline}'))
val_dataloader = dict(dataset=dict(pipeline='${eval_pipeline}'))
