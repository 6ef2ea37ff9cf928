# What every data set with a class for each point shares. The file of a data set sets dataset_type, data_root, the splits,
# num_classes, thing_classes, point_columns and what else its reader wants.
train_split = 'train'
val_split = 'val'
voxel_thin = None  # m; keep one point in each cube of this edge
bad_scenes = 'error'  # 'skip' leaves unusable scenes out, with a counted warning

train_dataloader = dict(
    batch_size='${batch_size}',
    num_workers='${num_workers}',
    persistent_workers=False,
    collate_fn=dict(type='pseudo_collate'),
    sampler=dict(type='EpochSampler', shuffle=True),
    dataset=dict(
        type='${dataset_type}',
        data_root='${data_root}',
        split='${train_split}',
        labels='store',
        label_store='${work_dir}/labels',
        voxel_thin='${voxel_thin}',
        bad_scenes='${bad_scenes}',
        seed='${seed}',
        pipeline='${train_pipeline}',
    ),
)
# The training scenes once more, without labels and augmentation: what the network says of them makes the next labels.
label_dataloader = dict(
    batch_size=1,
    num_workers='${num_workers}',
    persistent_workers=False,
    collate_fn=dict(type='pseudo_collate'),
    sampler=dict(type='DefaultSampler', shuffle=False),
    dataset=dict(
        type='${dataset_type}',
        data_root='${data_root}',
        split='${train_split}',
        labels='none',
        voxel_thin='${voxel_thin}',
        bad_scenes='${bad_scenes}',
        pipeline=[dict(type='PackScene')],
    ),
)
val_dataloader = dict(
    batch_size=1,
    num_workers='${num_workers}',
    persistent_workers=False,
    collate_fn=dict(type='pseudo_collate'),
    sampler=dict(type='DefaultSampler', shuffle=False),
    dataset=dict(
        type='${dataset_type}',
        data_root='${data_root}',
        split='${val_split}',
        labels='truth',
        voxel_thin='${voxel_thin}',
        bad_scenes='${bad_scenes}',
        pipeline=[dict(type='PackScene')],
    ),
)
test_dataloader = '${val_dataloader}'
val_evaluator = [dict(type='SemSegMetric')]
test_evaluator = '${val_evaluator}'
