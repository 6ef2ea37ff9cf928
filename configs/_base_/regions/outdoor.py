# How the points of streets become regions and regions merge (METHOD 3, 5, 6). The ground, which has classes too, is cut into
# squares; what stands on it grows. How many of the first labels are right on real scans: docs/RESULTS.md.
descriptor = dict(type='AdaptedPFH', radius=0.4, range_growth=0.1, max_neighbors=48)
oversegmenter = dict(
    type='GroundPatches',
    cell='${ground_cell}',
    rest=dict(
        type='RegionGrowing',
        threshold=0.9,
        zeta=0.02,
        min_region=10,
        max_edge='${region_reach}',
        range_growth='${region_reach_growth}',
    ),
)
ground_cell = 1.5  # m; smaller where ground has many classes
region_reach = 0.3  # m between points of a region, at the sensor
region_reach_growth = 0.01  # m a metre of range, where the sensor is known
graph_neighbors = 8
max_gap = 0.6  # m between adjacent regions
region_seeds = 'none'  # 'revealed': regions grow from the revealed points first; then each budget has its own
spread = True  # False: training sees the revealed points alone
gamma = 0.75  # softmax from which a region is confident
strategy = dict(rounds='${rounds}', centre_distance=1.0, gamma='${gamma}')

custom_hooks = [
    dict(type='EpochSeedHook'),
    dict(
        type='RegionMergeHook',
        interval='${sigma}',
        rounds='${label_rounds}',
        first_rounds='${first_rounds}',
        dataloader='${label_dataloader}',
        labeler=dict(
            type='PointLabeler',
            store='${work_dir}/labels',
            cache='${cache_dir}',
            source=dict(
                type='PointBudgetSource',
                dataset='${label_dataloader.dataset}',
                budget='${budget}',
                seed='${budget_seed}',
            ),
            descriptor='${descriptor}',
            oversegmenter='${oversegmenter}',
            strategy='${strategy}',
            graph_neighbors='${graph_neighbors}',
            max_gap='${max_gap}',
            seeds='${region_seeds}',
            spread='${spread}',
            seed='${budget_seed}',
        ),
    ),
    dict(type='SafeCheckpointHook'),
    dict(type='RunRecordHook'),
    dict(type='ReportHook'),
]
