"""What stands above and below a point, column by column."""

import numpy as np


def slow_clearance(xyz, cell, reach):
    cells = [tuple(int(v) for v in np.floor(p.astype(np.float64) / cell)) for p in xyz]
    filled = set(cells)
    out = []
    for x, y, z in cells:
        levels = sorted({c for a, b, c in filled if max(abs(a - x), abs(b - y)) <= reach})
        below, above = [v for v in levels if v < z], [v for v in levels if v > z]
        out.append(
            [
                (levels[-1] - levels[0]) * cell / 15,
                (z - levels[0]) * cell / 15,
                (levels[-1] - z) * cell / 15,
                (z - below[-1] - 1) * cell / 10 if below else 1,
                (above[0] - z - 1) * cell / 10 if above else 1,
                len(levels) / (levels[-1] - levels[0] + 1),
            ]
        )
    return np.minimum(np.array(out).reshape(-1, 6), 1)
