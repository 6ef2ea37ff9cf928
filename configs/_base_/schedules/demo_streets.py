# What --demo changes for streets: embedded synthetic data, a smaller network without augmented views, few small steps. The
# scenes are so few that all stay in memory. Patches of ground are wide, as points far from the sensor lie metres apart, and
# annotated labels keep a fifth of the loss, as those that spread are mostly of wide flat things. On level ground the nearest
# annotated point names each point, however far off where many are annotated; later the network has a say, too.
demo = dict(
    data_root='data/${demo_data.scenes}',
    crop_points=24000,
    recent_scenes=64,
    rounds=3,
    sigma=12,
    batch_size=1,
    voxel_size=0.3,
    widths=[16, 32, 48, 64, 80, 96],
    blocks=1,
    class_power=0.5,
    aug_prob=0.0,
    param_scheduler='${one_cycle}',
    learning_rate=1e-2,  # from the first step on it would be too much
    val_rounds=3,
    checkpoint_interval='${sigma}',
    ground_cell=4.0,
    annotated_share=0.2,
    oversegmenter=dict(rest=dict(zeta=0.05)),
    propagation=dict(_delete_=True, max_extent=3.0),
    ground=dict(_delete_=True, max_distance='${ground_reach}'),
)
ground_reach = None  # m; of budgets of a few points a scene, which say nothing of what lies far off
one_cycle = [
    dict(
        type='OneCycleLR',
        eta_max='${learning_rate}',
        total_steps='${epochs}',
        pct_start=0.1,
        by_epoch=True,
        convert_to_iter_based=True,
    )
]
