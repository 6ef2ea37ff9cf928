# What all configs of semantic segmentation on ScanNet share; a leaf adds a budget.
_base_ = [
    '../runtime.py',
    '../datasets/scannet.py',
    '../models/segmentor_paper.py',
    '../regions/indoor.py',
    '../schedules/segmentation.py',
    '../schedules/demo_rooms.py',
]
demo = dict(demo_data=dict(scenes='scannet_rooms', num_train=24, num_val=8, seed=0))
