# What --demo changes for streets: embedded synthetic data, a smaller network, fewer epochs.
demo = dict(
    data_root='data/${demo_data.scenes}',
    crop_points=20000,
    rounds=5,
    sigma=4,
    batch_size=2,
    voxel_size=0.2,
    widths=[16, 32, 48, 64],
    blocks=1,
    param_scheduler='${restart_schedule}',
    periods=[4, 4, 4, 4, 4],
    restart_weights=[1, 1, 1, 1, 1],
    learning_rate=4e-3,
    val_rounds=5,
)
