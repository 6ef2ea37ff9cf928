"""Synthetic streets: boxes, and classes of points."""

from rm3d_plugin.experiments.spec import Table, full_row, method_rows

KITTI = Table(
    title='3D AP (moderate, R40) on synthetic streets; IoU .5 for cars, .25 for pedestrians and cyclists',
    rows=method_rows('votenet', 'kitti', ['1pct']),
    scores={
        'Car': 'Car_3d_moderate_R40@0.50',
        'Pedestrian': 'Pedestrian_3d_moderate_R40@0.25',
        'Cyclist': 'Cyclist_3d_moderate_R40@0.25',
        'mean': 'mAP_3d_moderate_R40_loose',
    },
    reference=full_row('votenet'),
)
STREETS = Table(
    title='mIoU on synthetic streets, in percent',
    rows=method_rows('sem', 'semantickitti', ['0p2pct', 'onept']),
    scores={'mIoU': 'mIoU'},
    reference=full_row('sem'),
    labels=True,
)
STREETS_BUDGETS = Table(
    title='mIoU on synthetic streets, in percent; other budgets',
    rows=method_rows('sem', 'semantickitti', ['20pts', '1pct']),
    scores={'mIoU': 'mIoU'},
    reference=full_row('sem'),
    labels=True,
)
