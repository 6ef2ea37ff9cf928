"""Points as raw float32 records: how many numbers each has is in no header."""

import string
import warnings
from pathlib import Path

import numpy as np
from jaxtyping import Float

from rm3d_plugin.structures import SceneError

RECORDS = {
    3: 'x y z',
    4: 'x y z intensity',
    5: 'x y z intensity -',
    6: 'x y z intensity - -',
}
"""What a record of so many numbers holds: KITTI has 4; nuScenes adds the ring, merged sweeps the time."""
USUAL = 4
WIDER = range(7, 17)  # numbers a point that a file may have, but whose meaning nobody can know
_ENOUGH = 60  # points from which a width is told
_LOOKED_AT = 1 << 14  # numbers
_RINGS = 31  # the highest ring of a lidar of 32
_FAR = 20.0  # times nine tenths of the numbers
_ODD = 0.2  # share of numbers that make no sense
_CLEAR = 0.2  # a width is told where the logarithm of the scatter within columns is so much lower
_PATTERN = 1.0  # the same for multiples of 4: lidars fire in patterns, so every second point is alike, too


def float_width(data: bytes, name: str = '') -> int:
    """How many float32 numbers a point has, as the numbers themselves suggest; 4 where nothing speaks against it.

    Read with the right width, a column holds one quantity. With a wrong one each column mixes several, and scatters
    more: the width with the least mean logarithm of the scatter is taken, where it is clearly less than that of 4.

    Args:
        data: A file's content.
        name: Of the file: ``.pcd.bin`` is how nuScenes names five numbers a point.
    """
    if name.lower().endswith('.pcd.bin') and len(data) % 20 == 0:
        return 5
    numbers = np.frombuffer(data[: len(data) // 4 * 4][: 4 * _LOOKED_AT], dtype='<f4')
    if len(numbers) < USUAL * _ENOUGH or not np.isfinite(numbers).all():
        return USUAL
    greatest = _FAR * np.quantile(np.abs(numbers), 0.9)
    numbers = np.clip(numbers, -greatest, greatest)  # one stray point is no reason for another width
    fitting = [width for width in (*RECORDS, *WIDER) if len(data) % (4 * width) == 0 or width == USUAL]
    scatter = {width: _scatter(numbers, width) for width in fitting}
    for kind in (RECORDS, WIDER):  # a pattern of points makes twice 5 as good as 5, and better
        clear = [
            width
            for width in fitting
            if width in kind and scatter[width] <= scatter[USUAL] - (_CLEAR if width % USUAL else _PATTERN)
        ]
        least = min((scatter[width] for width in clear), default=np.inf)
        if clear:
            return min(width for width in clear if scatter[width] < least + _CLEAR)  # twice 3 is as good as 3
    return USUAL


def _scatter(numbers: np.ndarray, width: int) -> float:
    table = numbers[: len(numbers) // width * width].reshape(-1, width).astype(np.float64)
    return float(np.log(table.std(axis=0) + 1e-2).mean())


def holds_colors(table: Float[np.ndarray, 'points 6']) -> bool:
    """Whether records of six end in colours, as mmdetection3d's rooms do: whole numbers to 255, no ring, no time."""
    last = table[:_LOOKED_AT, 3:6]
    whole = len(last) > 0 and last.min() >= 0 and last.max() <= 255 and not (last % 1).any()
    return bool(whole and last.max(axis=0).min() > _RINGS)


def holds_doubles(data: bytes) -> bool:
    """Whether bytes make sense as float64 and, to a fifth or more, none as float32.

    Half of the bytes of a double are the end of its digits, which as float32 are of any size.
    """
    if not data or (len(data) % 24 and len(data) % 32):
        return False
    single, double = (np.frombuffer(data[: 8 * _LOOKED_AT], dtype=kind) for kind in ('<f4', '<f8'))
    return bool(_sensible(double).all() and _sensible(single).mean() < 1 - _ODD)


def check_sense(data: bytes, path: Path) -> None:
    """Whether bytes make sense as float32 at all.

    Raises:
        SceneError: A fifth or more of the numbers are absurd: another byte order, another type, or text.
    """
    whole = data[: len(data) // 4 * 4][: 4 * _LOOKED_AT]
    numbers, swapped = (np.frombuffer(whole, dtype=kind) for kind in ('<f4', '>f4'))
    if len(numbers) and (_sensible(numbers) | np.isnan(numbers)).mean() <= 1 - _ODD:
        text = not set(whole) - set(string.printable.encode())
        swap = not text and _sensible(swapped).all()
        what = 'big-endian: save them little-endian' if swap else f'{"text" if text else "another type"}, or damaged?'
        raise SceneError(f'{path}: its numbers make no sense as float32 ({numbers[0]:.3g}, say); {what}')


def _sensible(numbers: np.ndarray) -> np.ndarray:
    size = np.abs(numbers)
    found: np.ndarray = (size == 0) | ((size > 1e-9) & (size < 1e9))  # NaN compares as False
    return found


def check_float_width(data: bytes, width: int, path: Path) -> None:
    """Whether a file of a known kind holds the records of that kind.

    Raises:
        SceneError: It is cut off, or its numbers fit another width or are absurd.
    """
    check_sense(data, path)
    found = float_width(data, path.name)
    if found % width:
        raise SceneError(
            f'{path}: looks like {found} columns of float32 a point ({RECORDS.get(found, "of unknown meaning")}); '
            f'expected {width}; save the first {width} alone'
        )
    if found != width:
        warnings.warn(f'{path}: looks like {found} float32 a point; read as {width}', stacklevel=3)
    if len(data) % (4 * width):
        raise SceneError(
            f'{path}: {len(data)} bytes are no multiple of {4 * width} ({width} float32 a point); cut off?'
        )
