# Semantic3D, native text files: 8 classes; three of the 15 training stations are held out for validation.
_base_ = './outdoor_pipeline.py'
dataset_type = 'Semantic3DDataset'
data_root = 'data/semantic3d'
num_classes = 8
thing_classes = []
point_columns = ['intensity', 'rgb', 'shape']
voxel_downsample = 0.05  # m; a station has up to 10^8 points
train_dataloader = dict(dataset=dict(cache='${cache_dir}'))
label_dataloader = dict(dataset=dict(cache='${cache_dir}'))
val_dataloader = dict(dataset=dict(cache='${cache_dir}'))
