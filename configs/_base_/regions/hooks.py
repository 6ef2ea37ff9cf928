# The hooks of every run; `labeler` makes the labels of each round from regions and what the budget reveals (METHOD 1).
graph_neighbors = 8
labeler = dict(
    store='${work_dir}/labels',
    cache='${cache_dir}',
    source=dict(dataset='${label_dataloader.dataset}', budget='${budget}', seed='${budget_seed}'),
    descriptor='${descriptor}',
    oversegmenter='${oversegmenter}',
    strategy='${strategy}',
    graph_neighbors='${graph_neighbors}',
    max_gap='${max_gap}',
)
custom_hooks = [
    dict(type='EpochSeedHook'),
    dict(
        type='RegionMergeHook',
        interval='${sigma}',
        rounds='${label_rounds}',
        first_rounds='${first_rounds}',
        dataloader='${label_dataloader}',
        labeler='${labeler}',
    ),
    dict(type='SafeCheckpointHook'),
    dict(type='RunRecordHook'),
    dict(type='ReportHook'),
]
