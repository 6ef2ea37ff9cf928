# What every data set with a class for each point shares. The file of a data set sets dataset_type, data_root, the splits,
# num_classes, thing_classes, point_columns and what else its reader wants.
_base_ = './loaders.py'
train_split = 'train'
val_split = 'val'
voxel_downsample = None  # m; keep one point in each cube of this edge

train_dataloader = dict(
    dataset=dict(
        type='${dataset_type}',
        split='${train_split}',
        voxel_downsample='${voxel_downsample}',
        pipeline='${train_pipeline}',
    ),
)
label_dataloader = dict(
    dataset=dict(
        type='${dataset_type}',
        split='${train_split}',
        voxel_downsample='${voxel_downsample}',
        pipeline=[dict(type='PackScene')],
    ),
)
val_dataloader = dict(
    dataset=dict(
        type='${dataset_type}',
        split='${val_split}',
        voxel_downsample='${voxel_downsample}',
        pipeline=[dict(type='PackScene')],
    ),
)
val_evaluator = [dict(type='SemSegMetric')]
