# Eight rounds of 40 epochs, Adam, learning rate x 0.1 at a quarter and at half of training (paper, 4.1).
_base_ = './rounds.py'
sigma = 40  # epochs a round
batch_size = 16
milestones = [80, 160]  # epochs
step_schedule = [dict(type='MultiStepLR', by_epoch=True, milestones='${milestones}', gamma=0.1)]
periods = [40, 40, 40, 40, 40, 40, 40, 40]  # epochs, of the restart schedule

# What --demo changes: embedded synthetic data, a smaller network, fewer epochs.
demo = dict(
    data_root='data/demo_streets',
    oversegmenter=dict(max_edge=0.3, range_growth=0.015),  # half as many points a turn as KITTI
    demo_data=dict(scenes='streets', num_train=100, num_val=40, seed=0),
    rounds=10,
    sigma=4,
    warm_up_rounds=6,
    batch_size=4,
    widths=[16, 32, 48, 64],
    voxel_size=0.15,
    hidden=64,
    blocks=1,
    num_seeds=512,
    num_proposals=128,
    param_scheduler='${restart_schedule}',
    periods=[24, 4, 4, 4, 4],
    restart_weights=[1, 1, 1, 1, 1],
    learning_rate=2e-3,
    val_rounds=10,
)
