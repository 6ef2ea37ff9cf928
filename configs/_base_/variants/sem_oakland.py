# Semantic segmentation of Oakland; a leaf adds a budget. There are no demo scenes in this format.
_base_ = [
    '../runtime.py',
    '../datasets/oakland.py',
    '../models/segmentor_tiles.py',
    '../regions/outdoor_tiles.py',
    '../schedules/tiles.py',
]
sigma = 34
periods = [34, 68]  # epochs
checkpoint_interval = '${sigma}'
class_power = 0.7
model = dict(inference=dict(votes=4))  # at test time tiles are read from four sides
