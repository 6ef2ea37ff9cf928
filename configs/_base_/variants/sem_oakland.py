# Semantic segmentation of Oakland; a leaf adds a budget. There are no demo scenes in this format.
_base_ = [
    '../runtime.py',
    '../datasets/oakland.py',
    '../models/segmentor_tiles.py',
    '../regions/outdoor_tiles.py',
    '../schedules/tiles.py',
]
checkpoint_interval = '${sigma}'
