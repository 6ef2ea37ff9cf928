"""Columns of a scan in a file that is written: under free names, as numbers that other programs know."""

from collections.abc import Iterable, Mapping

import numpy as np

from rm3d_plugin.storage.ply import NAMES

GIVEN = 'input_'  # before the name of a field that would hide one that is added
Arrays = Mapping[str, np.ndarray]


def kept_names(names: Iterable[str], added: Arrays) -> dict[str, str]:
    """Name in the file -> name in the output; CloudCompare's ``scalar_label`` counts as ``label``."""
    out: dict[str, str] = {}
    every = list(names)
    for name in every:
        out[name] = name
        while out[name].lower().removeprefix('scalar_') in added or (out[name] != name and out[name] in every):
            out[name] = GIVEN + out[name]
    return out


def plain_numbers(values: np.ndarray) -> np.ndarray:
    """The column in a type that PLY and LAS know; 64-bit integers become 32-bit ones, or double where large."""
    if values.dtype.str[1:] in NAMES:
        return values
    if values.dtype.kind == 'f':
        return values.astype(np.float32 if values.dtype.itemsize < 4 else np.float64)
    small = values.astype(np.int32)
    return small if np.array_equal(small, values) else values.astype(np.float64)
