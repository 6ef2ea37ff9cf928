# A handful of large scenes on a CPU: each epoch is one crop of each, small steps, two refreshes of the labels.
_base_ = './segmentation.py'
rounds = 3
sigma = 27
periods = [27, 54]  # epochs; the refresh in the middle of the second does not disturb it
restart_weights = [1, 0.8]
param_scheduler = '${restart_schedule}'
batch_size = 1
learning_rate = 4e-3
val_rounds = 3
