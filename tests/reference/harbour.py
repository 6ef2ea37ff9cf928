"""A few own scans with boxes of two classes."""

from pathlib import Path

import numpy as np

from rm3d_plugin.datasets.box_formats import BOX_FORMATS
from rm3d_plugin.datasets.named_boxes import NamedBoxes


def make_harbour(root: Path, scans: int = 4, points: int = 60) -> Path:
    """Flat water, a boat and a buoy in each scan; the last scan is for validation, too."""
    rng = np.random.default_rng(1)
    (root / 'points').mkdir(parents=True)
    for number in range(scans):
        boxes = np.array([[8.0 + number, 3, 1, 4, 2, 2, 0.3], [-6, -5.0 - number, 0.5, 1, 1, 1, 0]])
        inside = [box[:3] + rng.uniform(-0.45, 0.45, (points, 3)) * box[3:6].min() for box in boxes]
        water = np.c_[rng.uniform(-20, 20, (400, 2)), rng.normal(0, 0.01, 400)]
        xyz = np.concatenate([*inside, water])
        np.save(root / 'points' / f'{number:03d}.npy', np.c_[xyz, rng.uniform(0, 5000, len(xyz))].astype(np.float32))
        named = NamedBoxes(['boat', 'buoy'], boxes)
        BOX_FORMATS['openpcdet'].write(root / 'labels' / f'{number:03d}.txt', named, '', None)
    names = [f'{number:03d}\n' for number in range(scans)]
    (root / 'train.txt').write_text(''.join(names))
    (root / 'val.txt').write_text(names[-1])
    return root
