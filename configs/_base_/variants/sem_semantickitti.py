# What all configs of semantic segmentation on SemanticKITTI share; a leaf adds a budget.
_base_ = [
    '../runtime.py',
    '../datasets/semantickitti.py',
    '../models/segmentor_outdoor.py',
    '../regions/outdoor.py',
    '../schedules/segmentation.py',
    '../schedules/demo_streets.py',
]
region_prior = dict(heading=True)  # a vehicle's scans
demo = dict(
    demo_data=dict(scenes='semantickitti_streets', num_train=64, num_val=14, seed=0),
    sigma=6,
    ground=dict(classifier='kernel', heading=True),
)
