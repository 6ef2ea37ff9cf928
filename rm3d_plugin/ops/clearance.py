"""What stands above and below a point: free space and what fills it, in upright columns of cubic cells."""

import numpy as np
from jaxtyping import Float, Int

FAR = 10.0  # m of free space that count 1
TALL = 15.0  # m of height that count 1


def clearance(xyz: Float[np.ndarray, 'points 3'], cell: float = 0.5, reach: int = 0) -> Float[np.ndarray, 'points 6']:
    """Six numbers in [0, 1] that tell a wire from a crown and a pole from a facade, however dense the scan is.

    They are: height of all that stands in the column; height above its lowest cell; height below its topmost cell; free
    space right below and right above the point's cell (1 where nothing follows); share of the cells between the lowest
    and the topmost that hold points.

    Args:
        xyz: (n, 3) metres, z the height above the ground.
        cell: Metres; edge of a cell. Cells are aligned to the coordinates' zero.
        reach: Cells by which a column is wider to each side; larger: more of the surroundings, fewer gaps by chance.
    """
    if len(xyz) == 0:
        return np.zeros((0, 6), dtype=np.float32)
    cells = np.floor(np.asarray(xyz, dtype=np.float64) / cell).astype(np.int64)
    own, back = np.unique(cells, axis=0, return_inverse=True)
    steps = np.arange(-reach, reach + 1)
    shifts = np.stack(np.meshgrid(steps, steps, [0], indexing='ij'), axis=-1).reshape(-1, 3)
    filled = np.unique((own[:, None] + shifts).reshape(-1, 3), axis=0)  # by column, then upwards
    return _looks(filled, _rows_of(own, filled), cell)[back.reshape(-1)]


def _rows_of(some: Int[np.ndarray, 'some 3'], cells: Int[np.ndarray, 'cells 3']) -> Int[np.ndarray, ' some']:
    """Row of each cell among all of them."""
    low, span = cells.min(axis=0), np.ptp(cells, axis=0) + 1

    def number(rows: np.ndarray) -> np.ndarray:
        x, y, z = (rows - low).T
        return (x * span[1] + y) * span[2] + z

    return np.searchsorted(number(cells), number(some))


def _looks(
    filled: Int[np.ndarray, 'cells 3'], rows: Int[np.ndarray, ' some'], cell: float
) -> Float[np.ndarray, 'some 6']:
    """The six numbers of some of the filled cells, which are sorted by column and then upwards."""
    level = filled[:, 2]
    same = (filled[1:, :2] == filled[:-1, :2]).all(axis=1)  # a cell and the next stand in one column
    gap = np.where(same, np.diff(level) - 1, np.inf)
    first = np.r_[True, ~same]
    column = np.cumsum(first) - 1
    bottom, top = level[first], level[np.r_[~same, True]]
    count = np.bincount(column)
    low, high, filling = (values[column] for values in (bottom, top, count / (top - bottom + 1)))
    values = [
        (high - low) * cell / TALL,
        (level - low) * cell / TALL,
        (high - level) * cell / TALL,
        np.r_[np.inf, gap] * cell / FAR,
        np.r_[gap, np.inf] * cell / FAR,
        filling,
    ]
    return np.stack([np.minimum(value[rows], 1.0) for value in values], axis=1).astype(np.float32)
