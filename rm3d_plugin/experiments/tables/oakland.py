"""Oakland, real data: every tile of the split is trained on or tested."""

from rm3d_plugin.datasets.oakland_format import CLASSES
from rm3d_plugin.experiments.spec import Table, method_rows

OAKLAND = Table(
    title='IoU on the test tiles of Oakland, in percent (real data: --cfg-options data_root=FOLDER)',
    rows=method_rows('sem', 'oakland', ['0p1pct', '1pct', '20pct'], full=False, train=()),
    scores={name: f'IoU_{name}' for name in CLASSES} | {'mIoU': 'mIoU'},
    labels=True,
)
