"""Synthetic rooms: classes and instances of points."""

from rm3d_plugin.experiments.spec import Table, full_row, method_rows

ROOMS = Table(
    title='mIoU on synthetic rooms, in percent',
    rows=method_rows('sem', 'scannet', ['0p2pct', 'onept']),
    scores={'mIoU': 'mIoU'},
    reference=full_row('sem'),
    labels=True,
)
ROOMS_BUDGETS = Table(
    title='mIoU on synthetic rooms, in percent; other budgets',
    rows=method_rows('sem', 'scannet', ['20pts', '1pct']),
    scores={'mIoU': 'mIoU'},
    reference=full_row('sem'),
    labels=True,
)
ROOMS_INSTANCES = Table(
    title='AP of instances on synthetic rooms, in percent',
    rows=method_rows('ins', 'scannet', ['0p2pct', 'onept']),
    scores={'mIoU': 'mIoU', 'AP': 'AP', 'AP25': 'AP25', 'AP50': 'AP50'},
    reference=full_row('ins'),
    labels=True,
)
