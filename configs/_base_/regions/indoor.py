# How points become regions and regions merge (METHOD 3, 5, 6), with lengths for rooms at 1 to 5 cm between points.
descriptor = dict(type='AdaptedPFH', radius=0.1)
oversegmenter = dict(type='RegionGrowing', zeta=0.015)
graph_neighbors = 8
max_gap = 0.1  # m between adjacent regions
region_seeds = 'none'  # 'revealed': regions grow from the revealed points first; then each budget has its own
spread = True  # False: training sees the revealed points alone
strategy = dict(rounds='${rounds}', centre_distance=0.3, mixed_regions='nearest')

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
