# What --demo changes for rooms: embedded synthetic data, a smaller network, fewer epochs.
demo = dict(
    data_root='data/${demo_data.scenes}',
    crop_points=30000,
    elastic_prob=0.0,
    rounds=5,
    sigma=6,
    batch_size=1,
    voxel_size=0.06,
    widths=[16, 32, 48, 64],
    blocks=1,
    class_balance='batch',
    param_scheduler='${restart_schedule}',
    periods=[6, 6, 6, 6, 6],
    restart_weights=[1, 1, 1, 1, 1],
    learning_rate=5e-3,
    val_rounds=5,
)
