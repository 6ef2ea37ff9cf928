# The hooks of every run; `label_maker` makes the labels of each round from regions and what the budget shows (METHOD 1).
graph_neighbors = 8
strategy = 'default'  # 'paper': `merge` alone, the method as the paper has it
self_training = dict()  # e.g. self_training.cbst_fraction=.2; None: off
label_maker = dict(
    store='${work_dir}/labels',
    cache='${cache_dir}',
    source=dict(dataset='${label_dataloader.dataset}', budget='${budget}', seed='${budget_seed}'),
    descriptor='${descriptor}',
    oversegmenter='${oversegmenter}',
    strategy='${strategy}',
    merge='${merge}',
    self_training='${self_training}',
    graph_neighbors='${graph_neighbors}',
    max_gap='${max_gap}',
)
custom_hooks = [
    dict(type='EpochSeedHook'),
    dict(
        type='RegionMergeHook',
        interval='${sigma}',
        rounds='${label_refreshes}',
        warm_up_rounds='${warm_up_rounds}',
        dataloader='${label_dataloader}',
        label_maker='${label_maker}',
    ),
    dict(type='SafeCheckpointHook'),
    dict(type='RunRecordHook'),
    dict(type='ReportHook'),
]
