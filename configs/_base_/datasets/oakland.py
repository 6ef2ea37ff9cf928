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
train_dataloader = dict(dataset=dict(tiles='${train_tiles}', cache='${cache_dir}'))
label_dataloader = dict(dataset=dict(tiles='${train_tiles}', cache='${cache_dir}'))
val_dataloader = dict(dataset=dict(tiles='${val_tiles}', cache='${cache_dir}'))
