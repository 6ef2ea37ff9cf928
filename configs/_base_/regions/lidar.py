# How points become regions and regions merge (METHOD 3, 5, 6), with lengths for a 64-beam street scan.
_base_ = './hooks.py'
descriptor = dict(type='AdaptedPFH', radius=0.3, range_growth=0.1, max_neighbors=48)
oversegmenter = dict(
    type='RegionGrowing',
    threshold=0.9,
    zeta=0.05,
    min_region=30,
    max_edge=0.2,  # m at the sensor
    range_growth=0.01,  # m a metre of range
    ground=dict(),  # taken away before growing
)
max_gap = 0.6  # m between adjacent regions
# The paper's gamma is .75 for all. Here unknown points count as background in part, so the network is taught that hidden
# objects are none, and no confidence means the same for every class and budget. So every group that is more likely an
# object than not becomes a candidate, its score asks the predicted boxes too, and the best share of each class, over all
# scenes, becomes pseudo boxes. The network alone never makes background.
objects = dict(
    gamma=0.4,
    class_gamma=[0.4, 0.4, 0.4, 1.1],  # as classes, then background
    support_iou=0.2,
    seen_height=[0.0, 0.7, 0.7],  # people are seen up to their heads
    seen_length=[0.0, 0.2, 0.2],
    top_fraction=[0.4, 0.45, 0.5, 0.5],
)
merge = dict(rounds='${rounds}', centre_distance=[1.2, 0.5, 0.7, None])  # m
label_maker = dict(type='DetectionLabelMaker', source=dict(type='BoxBudgetSource'), objects='${objects}')
