"""A process of random actions that says after each what is labelled; it is killed from outside.

Run as ``python killed_session.py SCAN SEED``.
"""

import json
import sys
from pathlib import Path

import numpy as np

from rm3d_plugin.annotation import Session


def main(scan: Path, seed: int) -> None:
    """Act until killed; one line of JSON, point -> class, after each action."""
    generator, name = np.random.default_rng(seed), scan.stem
    with Session([scan], classes=['floor', 'wall']) as session:
        while True:
            points = generator.integers(40, size=5).tolist()
            actions = (
                session.undo,
                session.redo,
                lambda points=points: session.brush(name, points, 'wall'),
                lambda points=points: session.erase(name, points[:3]),
                lambda points=points: session.click(name, points[0], 'floor'),
            )
            actions[int(generator.integers(len(actions)))]()
            annotated = session.scan(name).annotated
            labelled = np.flatnonzero(annotated >= 0).tolist()
            print(json.dumps({point: int(annotated[point]) for point in labelled}), flush=True)


if __name__ == '__main__':
    main(Path(sys.argv[1]), int(sys.argv[2]))
