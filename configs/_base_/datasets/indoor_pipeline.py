# Augmentation of rooms (METHOD 7).
_base_ = './points.py'
crop_points = 250000
elastic_prob = 0.95
train_pipeline = [
    dict(type='RandomCrop', max_points='${crop_points}', shape='column'),
    dict(type='GlobalRotScale', rot=[-3.1416, 3.1416], scale=[0.9, 1.1]),
    dict(type='RandomFlipY', prob=0.5),
    dict(type='ElasticDistortion', prob='${elastic_prob}'),
    dict(type='ColorAutoContrast'),
    dict(type='ColorJitter'),
    dict(type='AugmentedView', prob='${aug_prob}'),
    dict(type='PackScene'),
]
