# Semantic3D, native text files: 8 classes; three of the 15 training stations are held out for validation.
_base_ = './outdoor.py'
dataset_type = 'Semantic3DDataset'
data_root = 'data/semantic3d'
num_classes = 8
thing_classes = []
point_columns = ['intensity', 'rgb', 'shape']
voxel_downsample = 0.05  # m; a station has up to 10^8 points
train_dataloader = dict(dataset=dict(cache='${cache_dir}'))
label_dataloader = dict(dataset=dict(cache='${cache_dir}'))
val_dataloader = dict(dataset=dict(cache='${cache_dir}'))
region_prior = dict(classifier='neighbors', inverse_temperature=2.0)  # few stations, each unlike the others
demo = dict(demo_data=dict(scenes='semantic3d_streets', num_train=12, num_val=3, seed=0))
