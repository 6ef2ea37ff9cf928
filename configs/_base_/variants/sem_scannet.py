# What all configs of semantic segmentation on ScanNet share; a leaf adds a budget.
_base_ = [
    '../runtime.py',
    '../datasets/scannet.py',
    '../models/segmentor_paper.py',
    '../regions/indoor.py',
    '../schedules/segmentation.py',
    '../schedules/demo_rooms.py',
]
demo = dict(demo_data=dict(scenes='scannet_rooms', num_train=72, num_val=16, seed=0))
first_angle = 30.0  # degrees; rooms stand along the axes, which training on turned rooms hardly ever sees
