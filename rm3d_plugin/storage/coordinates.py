"""What is told of odd coordinates: stray points, lost digits, degrees and millimetres."""

import warnings
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

COARSE = 0.01  # m; float32 whose steps are larger has lost digits
SPARSE = 3.0  # m between neighbours; a scan in metres is denser
_SAMPLE = 2000  # points that spacing is estimated from
_ENOUGH = 500  # points from which their spacing is questioned
_FEW = 50  # points from which their extent is


def warn_of_strays(
    stray: Bool[np.ndarray, ' points'], xyz: Float[np.ndarray, 'points 3'], name: str, what: str
) -> None:
    """A warning that counts stray points and names the first, if there are any.

    Args:
        stray: From :func:`rm3d_plugin.structures.stray_points`.
        xyz: Of the points, world.
        name: Of the scan.
        what: What becomes of them.
    """
    if stray.any():
        first = int(np.flatnonzero(stray)[0])
        place = ', '.join(f'{value:g}' for value in xyz[first])
        warnings.warn(
            f'{name}: {int(stray.sum())} of {len(stray)} points lie far from all others (the first is point {first} '
            f'at {place}); {what}',
            stacklevel=3,
        )


def warn_of_units(xyz: Float[np.ndarray, 'points 3'], path: Path) -> None:
    """Warnings where finite coordinates look like degrees or millimetres, or have lost digits."""
    if len(xyz) == 0:
        return
    middle = np.abs(np.median(xyz, axis=0)).max()
    if xyz.dtype.kind == 'f' and (step := float(np.spacing(xyz.dtype.type(middle)))) > COARSE:
        warnings.warn(
            f'{path}: coordinates around {middle:g} are {xyz.dtype}, in steps of {step:g} m: digits are lost; '
            f'{"export them as double, or " * (xyz.dtype.itemsize < 8)}subtract an offset first',
            stacklevel=3,
        )
    if len(xyz) < _FEW:
        return
    sample = np.asarray(xyz[:: -(-len(xyz) // _SAMPLE)], dtype=np.float64)
    low, high = np.quantile(sample, (0.02, 0.98), axis=0)
    wide, tall = float((high - low)[:2].max()), float(high[2] - low[2])
    on_the_globe = np.all(np.abs(low[:2]) <= (180, 90)) and np.abs(low[:2]).max() > 1
    if on_the_globe and wide < 0.3 and tall > 20 * wide:
        warnings.warn(f'{path}: x and y look like degrees; expected metres: project them (to UTM, say)', stacklevel=3)
        return
    spacing = _spacing(sample, len(xyz)) if len(xyz) >= _ENOUGH else 0.0
    if spacing > SPARSE:
        warnings.warn(
            f'{path}: neighbouring points are about {spacing:.3g} apart in a scan {wide:.4g} wide; expected metres: '
            'are these millimetres? divide them by 1000 first',
            stacklevel=3,
        )


def _spacing(sample: np.ndarray, count: int) -> float:
    """Estimated distance of neighbours among ``count`` points on surfaces, of which some are given."""
    distance = cKDTree(sample).query(sample, k=2)[0][:, 1]
    return float(np.median(distance) * np.sqrt(len(sample) / count))
