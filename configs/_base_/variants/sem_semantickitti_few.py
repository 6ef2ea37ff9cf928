# Semantic segmentation of a handful of SemanticKITTI scans, some of them without remission, on a CPU; a leaf adds a budget.
_base_ = [
    '../runtime.py',
    '../datasets/semantickitti.py',
    '../models/segmentor_tiles.py',
    '../regions/outdoor.py',
    '../schedules/tiles.py',
    '../schedules/demo_streets.py',
]
use_intensity = False
point_columns = ['shape']
train_sequences = [0]
val_sequences = [1, 99]
crop_points = 16000
gamma = 0.9
sigma = 54
periods = [54, 108]
checkpoint_interval = '${sigma}'
demo = dict(
    demo_data=dict(scenes='semantickitti_streets', num_train=60, num_val=12, seed=0),
    train_sequences=None,
    val_sequences=None,
)
