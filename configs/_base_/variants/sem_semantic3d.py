# What all configs of semantic segmentation on Semantic3D share; a leaf adds a budget.
_base_ = [
    '../runtime.py',
    '../datasets/semantic3d.py',
    '../models/segmentor_outdoor.py',
    '../regions/outdoor.py',
    '../schedules/segmentation.py',
    '../schedules/demo_streets.py',
]
region_prior = dict(classifier='neighbors', inverse_temperature=2.0)  # few stations, each unlike the others
demo = dict(demo_data=dict(scenes='semantic3d_streets', num_train=12, num_val=3, seed=0))
