# What --demo changes for rooms: embedded synthetic data, coarser voxels and fewer epochs. The network stays deep, as a
# cupboard is told from a wall by what stands around it; a view for the consistency loss is taken of each fourth room.
demo = dict(
    data_root='data/${demo_data.scenes}',
    crop_points=30000,
    elastic_prob=0.0,
    aug_prob=0.25,
    rounds=4,
    sigma=5,
    batch_size=1,
    voxel_size=0.08,
    widths=[16, 32, 48, 64, 80, 96],
    blocks=1,
    class_balance='batch',
    param_scheduler='${restart_schedule}',
    periods=['${epochs}'],
    restart_weights=[1],
    learning_rate=1e-2,
    val_rounds=5,
)
