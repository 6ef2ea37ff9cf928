# What all configs of semantic segmentation on S3DIS share; a leaf adds a budget.
_base_ = [
    '../runtime.py',
    '../datasets/s3dis.py',
    '../models/segmentor_paper.py',
    '../regions/indoor.py',
    '../schedules/segmentation.py',
    '../schedules/demo_rooms.py',
]
demo = dict(demo_data=dict(scenes='s3dis_rooms', rooms_per_area=5, seed=0))
first_angle = 30.0  # degrees; rooms stand along the axes, which training on turned rooms hardly ever sees
