# A handful of large scenes: many crops of each, few epochs that are called so, on a CPU.
_base_ = './segmentation.py'
rounds = 4
sigma = 25
periods = [25, 25, 25, 25]
restart_weights = [1, 1, 1, 1]
param_scheduler = '${restart_schedule}'
batch_size = 2
learning_rate = 4e-3
val_rounds = 4
