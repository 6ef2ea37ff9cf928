# What every run shares.
custom_imports = dict(imports=['rm3d_plugin'], allow_failed_imports=False)
default_scope = 'rm3d_plugin'
seed = 0
threads = 0  # of our kernels; 0 = one for each core
num_workers = 0
accumulate = 1  # batches a step of the optimizer: a larger batch in the memory of a small one
cache_dir = 'work_dirs/geometry_cache'  # prepared scenes, keyed by content: runs share them
randomness = dict(seed='${seed}', deterministic=True)
env_cfg = dict(cudnn_benchmark=False, mp_cfg=dict(mp_start_method='fork', opencv_num_threads=0))
default_hooks = dict(
    timer=dict(type='IterTimerHook'),
    logger=dict(type='LoggerHook', interval=20, log_metric_by_epoch=True),
    param_scheduler=dict(type='ParamSchedulerHook'),
    sampler_seed=dict(type='DistSamplerSeedHook'),
    checkpoint=dict(
        type='CheckpointHook',
        interval='${checkpoint_interval}',
        max_keep_ckpts=2,
        backend_args=dict(backend='rm3d_atomic'),
    ),
)
checkpoint_interval = 1  # epochs
log_level = 'INFO'
visualizer = None
