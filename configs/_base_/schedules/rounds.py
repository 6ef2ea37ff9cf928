# What every schedule shares: rounds of labels, Adam, and the two ways in which the learning rate may fall.
rounds = 8
label_refreshes = '${rounds}'  # 1: the first labels stay
warm_up_rounds = 1  # rounds that the first labels last
learning_rate = 1e-3
val_rounds = 2

train_cfg = dict(type='RoundTrainLoop', rounds='${rounds}', sigma='${sigma}', val_rounds='${val_rounds}')
val_cfg = dict(type='ValLoop')
test_cfg = dict(type='TestLoop')
optim_wrapper = dict(
    type='OptimWrapper',
    optimizer=dict(type='Adam', lr='${learning_rate}'),
    clip_grad=dict(max_norm=10.0),
    accumulative_counts='${accumulate}',
)
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
restart_weights = [1, 1, 1, 1, 1, 1, 1, 1]
param_scheduler = '${step_schedule}'
