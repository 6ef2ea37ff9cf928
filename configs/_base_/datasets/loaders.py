# The data loaders of every run. The file of a data set says what it reads and how scenes are augmented.
bad_scenes = 'error'  # 'skip' leaves unusable scenes out, with a counted warning

train_dataloader = dict(
    batch_size='${batch_size}',
    num_workers='${num_workers}',
    persistent_workers=False,
    collate_fn=dict(type='pseudo_collate'),
    sampler=dict(type='EpochSampler', shuffle=True),
    dataset=dict(
        data_root='${data_root}',
        labels='store',
        label_store='${work_dir}/labels',
        bad_scenes='${bad_scenes}',
        seed='${seed}',
    ),
)
# The training scenes once more, without labels and augmentation: what the network says of them makes the next labels.
label_dataloader = dict(
    batch_size=1,
    num_workers='${num_workers}',
    persistent_workers=False,
    collate_fn=dict(type='pseudo_collate'),
    sampler=dict(type='DefaultSampler', shuffle=False),
    dataset=dict(data_root='${data_root}', labels='none', bad_scenes='${bad_scenes}'),
)
val_dataloader = dict(
    batch_size=1,
    num_workers='${num_workers}',
    persistent_workers=False,
    collate_fn=dict(type='pseudo_collate'),
    sampler=dict(type='DefaultSampler', shuffle=False),
    dataset=dict(data_root='${data_root}', labels='truth', bad_scenes='${bad_scenes}'),
)
test_dataloader = '${val_dataloader}'
test_evaluator = '${val_evaluator}'
