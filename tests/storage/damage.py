"""Ways in which files are damaged: bytes, values of JSON, arrays of an npz whose hash fits all the same."""

import copy

import numpy as np

TOKENS = (b'-1', b'1e999', b'nan', b'999999999999', b'list uchar int', b';', b',', b'\n', b'\x00', b'"', b'#', b'\xff')
VALUES = (None, -1, 10**30, float('inf'), float('nan'), '', 'x', '../../x', [], [[]], {}, {'a': 1}, True, 0.5, '<b>')


def damaged(data, rng):
    """The bytes cut, flipped, repeated, or with a telling token written into them, most often near the front."""
    data, way = bytearray(data), rng.integers(5)
    if not data:
        return b'\x00'
    at = int(rng.integers(len(data)) if rng.random() < 0.5 else rng.integers(min(len(data), 250)))
    if way == 0:
        return bytes(data[:at])
    if way == 1:
        for place in rng.integers(len(data), size=rng.integers(1, 9)):
            data[place] ^= 1 << int(rng.integers(8))
    elif way == 2:
        data[at:at] = data[at : at + int(rng.integers(1, 200))]
    else:
        token = TOKENS[rng.integers(len(TOKENS))]
        data[at : at + (len(token) if way == 3 else 0)] = token
    return bytes(data)


def damaged_value(content, rng):
    """A copy of plain values in which one, at any depth, is another, or is gone."""
    content = copy.deepcopy(content)
    holders = list(_holders(content))
    if not holders or rng.random() < 0.1:
        return VALUES[rng.integers(len(VALUES))]
    holder, key = holders[rng.integers(len(holders))]
    if rng.random() < 0.2:
        del holder[key]
    else:
        holder[key] = copy.deepcopy(VALUES[rng.integers(len(VALUES))])
    return content


def _holders(value):
    pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in pairs:
        yield value, key
        yield from _holders(item)


def damaged_arrays(arrays, rng):
    """A copy of named arrays in which one is gone, or has another shape, type or absurd values."""
    arrays = dict(arrays)
    name = sorted(arrays)[rng.integers(len(arrays))]
    array = arrays.pop(name)
    ways = (
        lambda: None,
        lambda: array[: len(array) // 2] if array.ndim else array.reshape(1),
        lambda: np.concatenate([array, array]) if array.ndim else np.array([array, array]),
        lambda: array.astype('U9'),
        lambda: array.astype(np.float32) + 0.5,
        lambda: np.full_like(array, -9) if array.dtype.kind in 'if' else array[None],
        lambda: np.full(array.shape, np.nan),
        lambda: np.full(array.shape, 2**62),
        lambda: array.reshape(-1, 1),
    )
    made = ways[rng.integers(len(ways))]()
    return arrays if made is None else {**arrays, name: made}
