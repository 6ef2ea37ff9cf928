# A check of the detector, not a method: learn the training frames by heart, with all boxes, and be scored on the same frames.
# Run: python tools/train.py configs/check_overfit_kitti.py --cfg-options data_root=FOLDER
# Score on eight real frames: docs/RESULTS.md.
_base_ = [
    './_base_/runtime.py',
    './_base_/datasets/kitti.py',
    './_base_/models/votenet_kitti.py',
    './_base_/regions/lidar.py',
    './_base_/budgets/boxes_full.py',
    './_base_/schedules/detection.py',
]
rounds = 1
sigma = 160
batch_size = 2
widths = [16, 32, 48, 64]
voxel_size = 0.15
blocks = 1
hidden = 64
num_seeds = 512
num_proposals = 128
learning_rate = 2e-3
checkpoint_interval = 20
param_scheduler = '${restart_schedule}'
periods = [160]
restart_weights = [1]
aug_loss = None
train_dataloader = dict(dataset=dict(pipeline=[dict(type='DropGround'), dict(type='PackScene')]))
val_dataloader = dict(dataset=dict(ann_file='ImageSets/train.txt'))
demo = dict(
    _delete_=True,
    data_root='data/demo_streets',
    demo_data=dict(num_train=100, num_val=40, seed=0),
    oversegmenter=dict(max_edge=0.3, range_growth=0.015),
    sigma=8,
    periods=[8],
)
