# KITTI object detection, native layout; only what the left camera sees.
data_root = 'data/kitti'
classes = ['Car', 'Pedestrian', 'Cyclist']
point_range = [0.0, -40.0, -3.0, 70.4, 40.0, 1.0]  # m, lidar frame: x, y, z least, then greatest
paste_objects = 8  # labelled objects of other frames copied into each training frame
bad_scenes = 'error'  # 'skip' leaves unusable frames out, with a counted warning

train_dataloader = dict(
    batch_size='${batch_size}',
    num_workers='${num_workers}',
    persistent_workers=False,
    collate_fn=dict(type='pseudo_collate'),
    sampler=dict(type='EpochSampler', shuffle=True),
    dataset=dict(
        type='KittiDataset',
        data_root='${data_root}',
        split='train',
        ann_file='ImageSets/train.txt',
        labels='store',
        label_store='${work_dir}/labels',
        classes='${classes}',
        point_range='${point_range}',
        bad_scenes='${bad_scenes}',
        seed='${seed}',
        pipeline=[
            dict(type='LabelledObjectPaste', max_objects='${paste_objects}'),
            dict(type='DropGround'),
            dict(type='RandomFlipY', prob=0.5),
            dict(type='GlobalRotScale', rot=[-0.785, 0.785], scale=[0.95, 1.05]),
            dict(type='AugmentedView'),
            dict(type='PackScene'),
        ],
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
        type='KittiDataset',
        data_root='${data_root}',
        split='train',
        ann_file='ImageSets/train.txt',
        labels='none',
        classes='${classes}',
        point_range='${point_range}',
        bad_scenes='${bad_scenes}',
        pipeline=[dict(type='DropGround'), dict(type='PackScene')],
    ),
)
val_dataloader = dict(
    batch_size=1,
    num_workers='${num_workers}',
    persistent_workers=False,
    collate_fn=dict(type='pseudo_collate'),
    sampler=dict(type='DefaultSampler', shuffle=False),
    dataset=dict(
        type='KittiDataset',
        data_root='${data_root}',
        split='val',
        ann_file='ImageSets/val.txt',
        labels='truth',
        classes='${classes}',
        point_range='${point_range}',
        bad_scenes='${bad_scenes}',
        pipeline=[dict(type='DropGround'), dict(type='PackScene')],
    ),
)
test_dataloader = '${val_dataloader}'
val_evaluator = [
    dict(type='KittiMetric', classes='${classes}', metrics=['bev', '3d'])
]  # a list: mmengine reads the key `metrics` of a plain dict itself
test_evaluator = '${val_evaluator}'
