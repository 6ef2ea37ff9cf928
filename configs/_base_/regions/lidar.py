# How points become regions and regions merge (METHOD 3, 5, 6), with lengths for a 64-beam street scan.
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
graph_neighbors = 8
max_gap = 0.6  # m between adjacent regions
# The paper's gamma is .75 for all. Here unknown points count as background in part, so the network is taught that hidden
# objects are none, and no confidence means the same for every class and budget. So every group that is more likely an
# object than not becomes a candidate, its score asks the predicted boxes too, and the best share of each class, over all
# scenes, becomes pseudo boxes. The network alone never makes background.
rules = dict(
    class_gamma=[0.4, 0.4, 0.4, 1.1],  # as classes, then background
    support_iou=0.2,
    seen_height=[0.0, 0.7, 0.7],  # people are seen up to their heads
    seen_length=[0.0, 0.2, 0.2],
    quota=[0.4, 0.45, 0.5, 0.5],
)
strategy = dict(rounds='${rounds}', gamma=0.4, centre_distance=[1.2, 0.5, 0.7, None])

custom_hooks = [
    dict(type='EpochSeedHook'),
    dict(
        type='RegionMergeHook',
        interval='${sigma}',
        rounds='${label_rounds}',
        first_rounds='${first_rounds}',
        dataloader='${label_dataloader}',
        labeler=dict(
            type='SceneLabeler',
            store='${work_dir}/labels',
            cache='${cache_dir}',
            source=dict(
                type='BoxBudgetSource',
                dataset='${label_dataloader.dataset}',
                budget='${budget}',
                seed='${budget_seed}',
            ),
            descriptor='${descriptor}',
            oversegmenter='${oversegmenter}',
            strategy='${strategy}',
            graph_neighbors='${graph_neighbors}',
            max_gap='${max_gap}',
            rules='${rules}',
        ),
    ),
    dict(type='SafeCheckpointHook'),
    dict(type='RunRecordHook'),
    dict(type='ReportHook'),
]
