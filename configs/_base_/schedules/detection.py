# Eight rounds of 40 epochs, Adam, learning rate x 0.1 at a quarter and at half of training (paper, 4.1).
rounds = 8
label_rounds = '${rounds}'  # 1: the first labels stay
sigma = 40  # epochs a round
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
)
param_scheduler = [dict(type='MultiStepLR', by_epoch=True, milestones='${milestones}', gamma=0.1)]
