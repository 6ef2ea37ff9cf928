# Oakland 3-D, native text tiles: 6 classes, neither colour nor intensity.
_base_ = './outdoor_pipeline.py'
dataset_type = 'OaklandDataset'
data_root = 'data/oakland'
val_split = 'test'
num_classes = 6
thing_classes = []
point_columns = ['shape']
crop_points = 16000
train_tiles = None  # None: those of the split
val_tiles = None
# Few tiles, so that others would look strange: crops are thinned, noised and scaled more than elsewhere.
train_pipeline = [
    dict(type='ShapeFeatures', cache='${cache_dir}'),
    dict(type='LevelGround'),
    dict(type='ClassCrop', max_points='${crop_points}'),
    dict(type='RandomThinning', keep=[0.4, 1.0]),
    dict(type='GlobalRotScale', rot=[-3.1416, 3.1416], scale=[0.8, 1.2]),
    dict(type='RandomFlipY', prob=0.5),
    dict(type='PointNoise', jitter=0.02, columns=0.05),  # m; shape columns
    dict(type='AugmentedView'),
    dict(type='PackScene'),
]
train_dataloader = dict(dataset=dict(tiles='${train_tiles}', cache='${cache_dir}'))
label_dataloader = dict(dataset=dict(tiles='${train_tiles}', cache='${cache_dir}'))
val_dataloader = dict(dataset=dict(tiles='${val_tiles}', cache='${cache_dir}'))
