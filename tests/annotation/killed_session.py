"""A process of random actions that says after each what is labelled; it is killed from outside.

Run as ``python killed_session.py SCAN SEED``.
"""

import json
import sys
from pathlib import Path

import numpy as np

from rm3d_plugin.annotation import Session


def main(scan: Path, seed: int) -> None:
    """Act until killed; one line of JSON, labels by point and boxes by object, after each action."""
    generator, name = np.random.default_rng(seed), scan.stem
    with Session([scan], classes=['floor', 'wall']) as session:
        while True:
            points = generator.integers(40, size=5).tolist()
            row = generator.uniform(1, 2, 7).round(4)
            actions = (
                session.undo,
                session.redo,
                lambda points=points: session.brush(name, points, 'wall'),
                lambda points=points: session.erase(name, points[:3]),
                lambda points=points: session.click(name, points[0], 'floor'),
                lambda points=points, row=row: session.objects.set_box(name, points[0] % 3, row, 'wall'),
            )
            actions[int(generator.integers(len(actions)))]()
            annotated = session.scan(name).annotated
            labels = {point: int(annotated[point]) for point in np.flatnonzero(annotated >= 0).tolist()}
            boxes = {number: box.row for number, box in session.objects.boxes(name).items()}
            print(json.dumps({'labels': labels, 'boxes': boxes}), flush=True)


if __name__ == '__main__':
    main(Path(sys.argv[1]), int(sys.argv[2]))
