# Eight rounds of 65 epochs, Adam, learning rate / 5 after 60 epochs of a round, then from the start again (METHOD 7).
rounds = 8
label_rounds = '${rounds}'  # 1: the first labels stay
sigma = 65  # epochs a round
first_rounds = 1  # rounds that the first labels last
batch_size = 8
learning_rate = 1e-3
val_rounds = 2
drops = [60, 125, 190, 255, 320, 385, 450, 515]  # epochs
restarts = [65, 130, 195, 260, 325, 390, 455]  # epochs

train_cfg = dict(type='RoundTrainLoop', rounds='${rounds}', sigma='${sigma}', val_rounds='${val_rounds}')
val_cfg = dict(type='ValLoop')
test_cfg = dict(type='TestLoop')
optim_wrapper = dict(
    type='OptimWrapper',
    optimizer=dict(type='Adam', lr='${learning_rate}'),
    clip_grad=dict(max_norm=10.0),
    accumulative_counts='${accumulate}',
)
step_schedule = [
    dict(type='MultiStepLR', by_epoch=True, milestones='${drops}', gamma=0.2),
    dict(type='MultiStepLR', by_epoch=True, milestones='${restarts}', gamma=5.0),
]
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
periods = [65, 65, 65, 65, 65, 65, 65, 65]  # epochs
restart_weights = [1, 1, 1, 1, 1, 1, 1, 1]
param_scheduler = '${step_schedule}'
