"""Which points of a street scan are ground: a smooth local surface under the scene, then a height threshold."""

import warnings
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from numba import njit

from rm3d_plugin.structures import SceneError, stray_points

PIT_DEPTH = 0.6  # m; a cell this far under its neighbours (beyond what a slope explains) holds a ghost return
UNSEEN_SLOPE = 0.1  # how fast the ground may rise where no point was measured
ACCEPT = 0.06  # m; residual at which a cell stops to count as ground in the last fit (three times that in the first)
WINDOW = 2.0  # cells; standard deviation of the window of a local plane
PYRAMID_STEP = 4  # each level of the fit is this much coarser than the one below
MAX_REACH = 32  # cells; how far a lone cell looks for others to compare with
MAX_CELLS = 16_000_000
FREE_CELLS = 250_000  # grids up to here are taken as they are
CELLS_A_POINT = 8  # larger grids than so many cells a point lose their empty stretches, then their resolution
GAP = 64  # cells; what is left of an empty stretch


class GroundResult(NamedTuple):
    """Ground or not, and how high above it.

    Attributes:
        is_ground: (N,) bool.
        height: (N,) float32 metres above the local ground surface (negative under it).
    """

    is_ground: Bool[np.ndarray, ' points']
    height: Float[np.ndarray, ' points']


class _Grid(NamedTuple):
    """Lowest point of each cell; x, y in cells from the grid's corner, z in metres (inf where the cell is empty)."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray


class _Surface(NamedTuple):
    """A plane for each cell, at its centre: height in metres, slopes in metres a cell."""

    height: np.ndarray
    slope_x: np.ndarray
    slope_y: np.ndarray


def segment_ground(
    points: Float[np.ndarray, 'points 3'],
    cell: float = 0.7,
    max_height: float = 0.2,
    max_slope: float = 0.3,
    iterations: int = 3,
) -> GroundResult:
    """Separate ground from what stands on it (METHOD 5: ground removal before growing).

    The lowest point of each cell votes. Votes above the lower envelope whose slope is limited (roofs, canopies, steep
    hill sides) start with little weight; then local planes are fitted in a pyramid of windows, so that a cell without
    ground borrows from its surroundings, and the weights follow the residuals. Stray points
    (see ``stray_points``) are no ground; their height is that over the nearest border.

    Args:
        points: Metres, z up; about level (a road may slope, the scan may not be tipped over).
        cell: Side of a cell in metres. Larger: smoother ground, cars in dense rows are safer, kerbs blur.
        max_height: Points less than this above the surface (metres) are ground.
        max_slope: Rise over run; what is steeper is not ground.
        iterations: Refits after the first one.

    Returns:
        The mask and the heights.

    Raises:
        SceneError: A coordinate is not finite.
        ValueError: A parameter is out of range.

    Warns:
        UserWarning: The points are so sparse that larger cells are used; or there are more than 16 million cells: then
            only the square of 4000 x 4000 around the middle is looked at; what lies outside is no ground, and its
            height is that over the nearest border.
    """
    if cell <= 0 or max_height <= 0 or max_slope <= 0 or iterations < 0:
        raise ValueError(
            f'segment_ground: expected cell, max_height, max_slope > 0 and iterations >= 0, '
            f'got {cell}, {max_height}, {max_slope}, {iterations}'
        )
    xyz = np.asarray(points, dtype=np.float64)
    if not np.isfinite(xyz).all():
        raise SceneError('segment_ground: points hold NaN or infinite coordinates; drop them first')
    if len(xyz) == 0:
        return GroundResult(np.zeros(0, dtype=np.bool_), np.zeros(0, dtype=np.float32))
    inside = ~stray_points(xyz)
    xy, cell = _grid_coordinates(xyz[:, :2], inside, cell)
    inside &= _middle(xy, inside, cell)
    xy -= xy[inside].min(axis=0)
    shape = np.floor(xy[inside].max(axis=0)) + 1
    z = np.ascontiguousarray(xyz[:, 2])
    grid = _lowest_points(xy[inside], z[inside], (int(shape[0]), int(shape[1])), max_slope * cell)
    surface = _fit_surface(grid, cell, max_slope, iterations)
    xy[~inside] = np.clip(xy[~inside], 0.0, shape - 0.5)
    height, steepness = _evaluate(xy, z, surface.height, surface.slope_x, surface.slope_y)
    is_ground = (height < max_height) & (steepness <= max_slope * cell) & inside
    return GroundResult(is_ground, height.astype(np.float32))


def _grid_coordinates(
    xy: Float[np.ndarray, 'points 2'], used: Bool[np.ndarray, ' points'], cell: float
) -> tuple[Float[np.ndarray, 'points 2'], float]:
    """Points in cells, and a cell's side: no more cells than the points in use deserve."""
    out = np.ascontiguousarray((xy - xy[used].min(axis=0)) / cell)
    most = max(FREE_CELLS, CELLS_A_POINT * len(xy))
    if _count_cells(out[used]) > most:
        out[used] = np.stack([_without_gaps(values) for values in out[used].T], axis=1)
    larger = 1
    while _count_cells(out[used] / larger) > most:
        larger *= 2
    if larger > 1:
        warnings.warn(
            f'segment_ground: {len(xy)} points in {_count_cells(out[used]):.0f} cells of {cell} m are sparse; cells of '
            f'{larger * cell} m are used (are the coordinates metres?)',
            stacklevel=3,
        )
    return out / larger, larger * cell


def _count_cells(xy: Float[np.ndarray, 'points 2']) -> float:
    shape = np.floor(np.ptp(xy, axis=0)) + 1
    return float(shape[0] * shape[1])


def _without_gaps(values: Float[np.ndarray, ' points']) -> Float[np.ndarray, ' points']:
    """The same places in their cells, where no more than GAP empty cells lie between two that are not."""
    found, number = np.unique(np.floor(values), return_inverse=True)
    excess = np.maximum(np.diff(found, prepend=found[:1]) - 1 - GAP, 0)
    return values - np.cumsum(excess)[number.reshape(-1)]


def _middle(
    xy: Float[np.ndarray, 'points 2'], used: Bool[np.ndarray, ' points'], cell: float
) -> Bool[np.ndarray, ' points']:
    """Points that are looked at: all, or where they need too many cells those in a square around the median."""
    cells = _count_cells(xy[used])
    if cells <= MAX_CELLS:
        return np.ones(len(xy), dtype=np.bool_)
    centre = xy[used][np.abs(xy[used] - np.median(xy[used], axis=0)).max(axis=1).argmin()]
    side = np.sqrt(MAX_CELLS) - 1
    inside: np.ndarray = (np.abs(xy - centre) < side / 2).all(axis=1)
    warnings.warn(
        f'segment_ground: {cells:.0f} cells of {cell} m are too many: {(~inside).sum()} of {len(xy)} points outside of '
        f'the middle {side * cell:.0f} m count as no ground; drop them or raise cell',
        stacklevel=3,
    )
    return inside


def _lowest_points(xy: np.ndarray, z: np.ndarray, shape: tuple[int, int], slope: float) -> _Grid:
    """Lowest point of each cell; ghost returns under the ground are passed over, in two rounds."""
    floor = np.full(shape, -np.inf)
    lowest = _lowest_above(xy, z, floor)
    for _ in range(2):
        if not _raise_floor_over_pits(lowest[2], floor, PIT_DEPTH, slope):
            break
        lowest = _lowest_above(xy, z, floor)
    return _Grid(*lowest)


def _fit_surface(grid: _Grid, cell: float, max_slope: float, iterations: int) -> _Surface:
    """Local planes through the lowest points, refitted as the weights follow the residuals."""
    known = np.isfinite(grid.z)
    envelope = _lower_envelope(grid.z, max_slope * cell, min(UNSEEN_SLOPE, max_slope) * cell)
    residual = np.where(known, grid.z - envelope, np.inf)
    for step in range(iterations + 1):
        accept = ACCEPT * (3.0 - 2.0 * step / max(iterations, 1))
        weight = np.exp(-np.square(np.maximum(residual, 0.0) / accept))
        surface = _fit_pyramid(weight, grid.x, grid.y, np.where(known, grid.z, 0.0))
        residual = np.where(known, grid.z - _at_lowest(grid, surface), np.inf)
    return surface


def _at_lowest(grid: _Grid, surface: _Surface) -> np.ndarray:
    """Surface height at each cell's lowest point."""
    rows, columns = np.indices(grid.z.shape)
    dx, dy = grid.x - rows - 0.5, grid.y - columns - 0.5
    return surface.height + surface.slope_x * dx + surface.slope_y * dy


def _fit_pyramid(weight: np.ndarray, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> _Surface:
    """Local planes from coarse to fine: the coarser level is the finer one's prior."""
    # Moments are taken about the grid's centre, which keeps the sums small.
    x0, y0 = weight.shape[0] / 2.0, weight.shape[1] / 2.0
    u, v = x - x0, y - y0
    moments = weight * np.stack([np.ones_like(u), u, v, u * u, u * v, v * v, z, z * u, z * v])
    levels = [moments]
    while max(levels[-1].shape[1:]) > PYRAMID_STEP:
        levels.append(_coarsen(levels[-1]))
    total = moments.sum(axis=(1, 2))
    mean = total[6] / total[0] if total[0] > 0 else 0.0
    top = levels[-1].shape[1:]
    prior = _Surface(np.full(top, mean), np.zeros(top), np.zeros(top))
    for level in range(len(levels) - 1, -1, -1):
        size = float(PYRAMID_STEP**level)
        prior = prior if level == len(levels) - 1 else _refine(prior, levels[level].shape[1:], size)
        prior = _Surface(*_solve(_blur(levels[level], _WINDOW_TAPS), *prior, size, x0, y0))
    return prior


def _coarsen(moments: np.ndarray) -> np.ndarray:
    """Sum blocks of cells."""
    pad = [(0, 0)] + [(0, -n % PYRAMID_STEP) for n in moments.shape[1:]]
    padded = np.pad(moments, pad)
    shape = (len(moments), padded.shape[1] // PYRAMID_STEP, PYRAMID_STEP, padded.shape[2] // PYRAMID_STEP, PYRAMID_STEP)
    return np.ascontiguousarray(padded.reshape(shape).sum(axis=(2, 4)))


def _refine(surface: _Surface, shape: tuple[int, ...], size: float) -> _Surface:
    """The coarser level's planes at the centres of the finer cells (of ``size`` finest cells) inside it."""
    rows, columns = np.indices(shape)
    i, j = rows // PYRAMID_STEP, columns // PYRAMID_STEP
    dx, dy = ((index % PYRAMID_STEP - (PYRAMID_STEP - 1) / 2.0) * size for index in (rows, columns))
    slope_x, slope_y = surface.slope_x[i, j], surface.slope_y[i, j]
    return _Surface(surface.height[i, j] + slope_x * dx + slope_y * dy, slope_x, slope_y)


@njit(cache=True)
def _lowest_above(xy: np.ndarray, z: np.ndarray, floor: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position of the lowest point of each cell that is not under the cell's floor."""
    lowest = np.full(floor.shape, np.inf)
    x, y = np.zeros(floor.shape), np.zeros(floor.shape)
    for p in range(len(z)):
        i, j = int(xy[p, 0]), int(xy[p, 1])
        if floor[i, j] <= z[p] < lowest[i, j]:
            lowest[i, j], x[i, j], y[i, j] = z[p], xy[p, 0], xy[p, 1]
    return x, y, lowest


@njit(cache=True)
def _raise_floor_over_pits(lowest: np.ndarray, floor: np.ndarray, depth: float, slope: float) -> bool:
    """Raise the floor of each cell far under the lower quartile of those around it (5 x 5 or more); True if any."""
    rows, columns = lowest.shape
    around = np.empty((2 * MAX_REACH + 1) ** 2)
    found = False
    for i in range(rows):
        for j in range(columns):
            if not np.isfinite(lowest[i, j]):
                continue
            n, reach = 0, 1
            while n < 4 and reach < MAX_REACH:
                n, reach = 0, 2 * reach
                for a in range(max(i - reach, 0), min(i + reach + 1, rows)):
                    for b in range(max(j - reach, 0), min(j + reach + 1, columns)):
                        if (a != i or b != j) and np.isfinite(lowest[a, b]):
                            around[n] = lowest[a, b]
                            n += 1
            if n < 4:
                continue
            limit = np.sort(around[:n])[n // 4] - depth - reach * slope
            if lowest[i, j] < limit:
                floor[i, j] = limit
                found = True
    return found


@njit(cache=True)
def _lower_envelope(lowest: np.ndarray, slope: float, unseen_slope: float) -> np.ndarray:
    """Greatest surface under the lowest points that rises by at most ``slope`` a cell (less where nothing was seen)."""
    rows, columns = lowest.shape
    envelope = lowest.copy()
    diagonal = np.sqrt(2.0)
    changed = True
    while changed:
        changed = False
        for way in (1, -1):  # two raster scans, each looking at the four neighbours it has passed
            for a in range(rows):
                i = a if way == 1 else rows - 1 - a
                for b in range(columns):
                    j = b if way == 1 else columns - 1 - b
                    rise = slope if np.isfinite(lowest[i, j]) else unseen_slope
                    best = envelope[i, j]
                    if 0 <= j - way < columns:
                        best = min(best, envelope[i, j - way] + rise)
                    if 0 <= i - way < rows:
                        best = min(best, envelope[i - way, j] + rise)
                        if j > 0:
                            best = min(best, envelope[i - way, j - 1] + diagonal * rise)
                        if j + 1 < columns:
                            best = min(best, envelope[i - way, j + 1] + diagonal * rise)
                    if best < envelope[i, j]:
                        envelope[i, j] = best
                        changed = True
    return envelope


@njit(cache=True)
def _blur(moments: np.ndarray, taps: np.ndarray) -> np.ndarray:
    """Separable window over the last two axes; nothing beyond the border."""
    channels, rows, columns = moments.shape
    reach = len(taps) // 2
    across = np.zeros_like(moments)
    out = np.zeros_like(moments)
    for c in range(channels):
        for i in range(rows):
            for a in range(max(i - reach, 0), min(i + reach + 1, rows)):
                tap = taps[a - i + reach]
                for j in range(columns):
                    across[c, i, j] += tap * moments[c, a, j]
        for i in range(rows):
            for t in range(-reach, reach + 1):
                tap = taps[t + reach]
                for j in range(max(-t, 0), min(columns - t, columns)):
                    out[c, i, j] += tap * across[c, i, j + t]
    return out


@njit(cache=True)
def _solve(
    moments: np.ndarray,
    height: np.ndarray,
    slope_x: np.ndarray,
    slope_y: np.ndarray,
    size: float,
    x0: float,
    y0: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weighted plane at each cell's centre, drawn to the prior plane by a quarter of one full vote."""
    new_height, new_x, new_y = np.empty_like(height), np.empty_like(height), np.empty_like(height)
    keep_height, keep_slope = 0.25, 1.0 * size * size
    for i in range(height.shape[0]):
        for j in range(height.shape[1]):
            u0, v0 = (i + 0.5) * size - x0, (j + 0.5) * size - y0
            w, u, v, uu, uv, vv, z, zu, zv = moments[:, i, j]
            # Shift to the centre of the cell and to the prior plane, so that the unknowns are corrections to it.
            uu, uv, vv = (
                uu - 2 * u0 * u + u0 * u0 * w,
                uv - u0 * v - v0 * u + u0 * v0 * w,
                vv - 2 * v0 * v + v0 * v0 * w,
            )
            zu, zv = zu - u0 * z, zv - v0 * z
            u, v = u - u0 * w, v - v0 * w
            h, gx, gy = height[i, j], slope_x[i, j], slope_y[i, j]
            r = z - h * w - gx * u - gy * v
            ru = zu - h * u - gx * uu - gy * uv
            rv = zv - h * v - gx * uv - gy * vv
            a, d, f = w + keep_height, uu + keep_slope, vv + keep_slope
            c0, c1, c2 = d * f - uv * uv, uv * v - u * f, u * uv - d * v
            det = a * c0 + u * c1 + v * c2
            new_height[i, j] = h + (c0 * r + c1 * ru + c2 * rv) / det
            new_x[i, j] = gx + (c1 * r + (a * f - v * v) * ru + (u * v - a * uv) * rv) / det
            new_y[i, j] = gy + (c2 * r + (u * v - a * uv) * ru + (a * d - u * u) * rv) / det
    return new_height, new_x, new_y


@njit(cache=True)
def _evaluate(
    xy: np.ndarray, z: np.ndarray, height: np.ndarray, slope_x: np.ndarray, slope_y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Height of each point over the planes of the four cells around it, blended; and how steep its own cell's is."""
    rows, columns = height.shape
    above, steep = np.empty(len(z)), np.empty(len(z))
    for p in range(len(z)):
        x, y = xy[p, 0], xy[p, 1]
        i0, j0 = int(np.floor(x - 0.5)), int(np.floor(y - 0.5))
        ground = 0.0
        for di in range(2):
            for dj in range(2):
                i, j = min(max(i0 + di, 0), rows - 1), min(max(j0 + dj, 0), columns - 1)
                share = (1.0 - abs(x - 0.5 - i0 - di)) * (1.0 - abs(y - 0.5 - j0 - dj))
                ground += share * (height[i, j] + slope_x[i, j] * (x - i - 0.5) + slope_y[i, j] * (y - j - 0.5))
        above[p] = z[p] - ground
        i, j = int(x), int(y)
        steep[p] = np.sqrt(slope_x[i, j] ** 2 + slope_y[i, j] ** 2)
    return above, steep


def _window_taps() -> np.ndarray:
    reach = int(3 * WINDOW)
    return np.exp(-0.5 * np.square(np.arange(-reach, reach + 1) / WINDOW))


_WINDOW_TAPS = _window_taps()
