# Eight rounds of 40 epochs, Adam, learning rate x 0.1 at a quarter and at half of training (paper, 4.1).
rounds = 8
label_rounds = '${rounds}'  # 1: the first labels stay
sigma = 40  # epochs a round
first_rounds = 1  # rounds that the first labels last
batch_size = 16
learning_rate = 1e-3
val_rounds = 2
milestones = [80, 160]  # epochs

train_cfg = dict(type='RoundTrainLoop', rounds='${rounds}', sigma='${sigma}', val_rounds='${val_rounds}')
val_cfg = dict(type='ValLoop')
test_cfg = dict(type='TestLoop')
optim_wrapper = dict(
    type='OptimWrapper',
    optimizer=dict(type='Adam', lr='${learning_rate}'),
    clip_grad=dict(max_norm=10.0),
    accumulative_counts='${accumulate}',
)
step_schedule = [dict(type='MultiStepLR', by_epoch=True, milestones='${milestones}', gamma=0.1)]
# Each period ends with a small step, so that the next labels come from a settled network.
restart_schedule = [
    dict(
        type='CosineRestartLR',
        by_epoch=True,
        convert_to_iter_based=True,
        periods='${periods}',
        restart_weights='${restart_weights}',
        eta_min=5e-5,
    )
]
periods = [40, 40, 40, 40, 40, 40, 40, 40]  # epochs
restart_weights = [1, 1, 1, 1, 1, 1, 1, 1]
param_scheduler = '${step_schedule}'

# What --demo changes: embedded synthetic data, a smaller network, fewer epochs.
demo = dict(
    data_root='data/demo_streets',
    oversegmenter=dict(max_edge=0.3, range_growth=0.015),  # half as many points a turn as KITTI
    demo_data=dict(scenes='streets', num_train=100, num_val=40, seed=0),
    rounds=10,
    sigma=4,
    first_rounds=6,
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
