# Eight rounds of 65 epochs, Adam, learning rate / 5 after 60 epochs of a round, then from the start again (METHOD 7).
_base_ = './rounds.py'
sigma = 65  # epochs a round
batch_size = 8
drops = [60, 125, 190, 255, 320, 385, 450, 515]  # epochs
restarts = [65, 130, 195, 260, 325, 390, 455]  # epochs
step_schedule = [
    dict(type='MultiStepLR', by_epoch=True, milestones='${drops}', gamma=0.2),
    dict(type='MultiStepLR', by_epoch=True, milestones='${restarts}', gamma=5.0),
]
periods = [65, 65, 65, 65, 65, 65, 65, 65]  # epochs, of the restart schedule
