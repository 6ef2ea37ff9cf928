# A check of the detector, not a method: learn the training frames by heart, with all boxes, and be scored on the same frames.
# Run: rm3d train check_overfit_kitti --cfg-options data_root=FOLDER
# Time: not measured.
# Score on eight real frames: docs/RESULTS.md.
_base_ = './_base_/kitti.py'
budget = 'full'
train_pipeline = [dict(type='DropGround'), dict(type='PackScene')]
val_dataloader = dict(dataset=dict(ann_file='ImageSets/train.txt'))
aug_loss = None
voxel_size = 0.15
widths = [16, 32, 48, 64]
blocks = 1
num_seeds = 512
num_proposals = 128
hidden = 64
rounds = 1
sigma = 160
periods = [160]
restart_weights = [1]
batch_size = 2
learning_rate = 2e-3
checkpoint_interval = 20
demo = dict(
    _delete_=True,
    data_root='data/demo_streets',
    demo_data=dict(scenes='streets', num_train=70, num_val=30, seed=0),
    oversegmenter=dict(max_edge=0.3, range_growth=0.015),  # m; the virtual lidar has half as many points a turn
    sigma=8,
    periods=[8],
)
