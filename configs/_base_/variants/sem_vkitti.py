# What all configs of semantic segmentation on vKITTI 3D share; a leaf adds a budget.
_base_ = [
    '../runtime.py',
    '../datasets/vkitti.py',
    '../models/segmentor_outdoor.py',
    '../regions/outdoor.py',
    '../schedules/segmentation.py',
    '../schedules/demo_streets.py',
]
demo = dict(demo_data=dict(scenes='vkitti_streets', num_train=16, num_val=14, seed=0))
