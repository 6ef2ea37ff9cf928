"""Predicted classes and instances of points as files that other programs read."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from rm3d_plugin.storage.files import atomic_write, write_text
from rm3d_plugin.storage.kept_columns import GIVEN, plain_numbers
from rm3d_plugin.storage.las import RGB
from rm3d_plugin.storage.text_columns import plain_name
from rm3d_plugin.structures import SceneError

USER_DEFINED = 64  # LAS 1.4: classes from here to 255 mean what the project says
NOT_CLASSIFIED = 1  # LAS: looked at, no class
_LAS_STEPS = 2_000_000_000  # steps to either side that a coordinate of LAS has room for
_LAS_NAME = 32  # letters of a dimension's name
_LINES = 1 << 20  # numbers turned to text at a time


def write_numbers(path: str | Path, numbers: Int[np.ndarray, ' points']) -> Path:
    """One whole number a line, as ScanNet and Semantic3D want their predictions; atomically, in bounded memory."""

    def write(file: Any) -> None:
        for first in range(0, len(numbers), _LINES):
            file.write(('\n'.join(map(str, numbers[first : first + _LINES].tolist())) + '\n').encode('ascii'))

    return atomic_write(path, write)


def write_instance_text(
    path: str | Path,
    masks: Bool[np.ndarray, 'instances points'],
    label_ids: Int[np.ndarray, ' instances'],
    scores: Float[np.ndarray, ' instances'],
) -> list[Path]:
    """Instances as ScanNet's benchmark wants them: ``SCENE.txt`` lists mask files with label id and score.

    Args:
        path: ``FOLDER/SCENE.txt``; the masks go to ``FOLDER/predicted_masks/SCENE_000.txt``, 0 or 1 a line.
        masks: Points of each instance.
        label_ids: Label ids of the benchmark.
        scores: Confidence.

    Returns:
        The list first, then the masks.
    """
    path = Path(path)
    names = [f'predicted_masks/{path.stem}_{number:03d}.txt' for number in range(len(masks))]
    files = [write_numbers(path.parent / name, mask.astype(np.int64)) for name, mask in zip(names, masks, strict=True)]
    rows = zip(names, label_ids.tolist(), scores.tolist(), strict=True)
    return [write_text(path, ''.join(f'{name} {kind} {score:.4f}\n' for name, kind, score in rows)), *files]


def write_label_words(
    path: str | Path, semantic: Int[np.ndarray, ' points'], instance: Int[np.ndarray, ' points']
) -> Path:
    """SemanticKITTI's ``.label``: one little-endian uint32 a point, instance number above the raw id.

    Args:
        path: The file.
        semantic: Raw ids, 0 = nothing said.
        instance: Instance numbers, 0 = none.

    Raises:
        ValueError: A number needs more than 16 bits.
    """
    for name, values in (('semantic', semantic), ('instance', instance)):
        if len(values) and not 0 <= values.min() <= values.max() < 1 << 16:
            raise ValueError(f'{path}: {name}: expected numbers of 16 bits, got {values.min()} to {values.max()}')
    words = semantic.astype('<u4') | instance.astype('<u4') << 16
    return atomic_write(path, lambda file: file.write(words.tobytes()))


def need_laspy(what: str | Path) -> Any:
    """The module laspy.

    Raises:
        SceneError: It is not installed; the message names the extra.
    """
    try:
        import laspy
    except ImportError as error:
        raise SceneError(f'{what}: writing LAS needs laspy; pip install "rm3d_plugin[las]"') from error
    return laspy


def write_las(
    path: str | Path,
    xyz: Float[np.ndarray, 'points 3'],
    colors: Float[np.ndarray, 'points 3'],
    label: Int[np.ndarray, ' points'],
    extra: Mapping[str, np.ndarray] | None = None,
    names: Sequence[str] = (),
    kept: Mapping[str, np.ndarray] | None = None,
) -> Path:
    """Write LAS 1.4, point format 7, atomically.

    The dimension ``label`` holds the class numbers, -1 = unknown. ``classification`` holds 64 + class (LAS leaves 64 to
    255 to the user), and 1 where unknown or above 191. Coordinates are kept to 0.1 mm; coarser above 400 km.

    Args:
        path: ``.las``.
        xyz: World coordinates, float64 metres.
        colors: In [0, 1].
        label: Class of each point.
        extra: Further dimensions by name; numbers of 32 bits.
        names: Class names, for the header's description.
        kept: Columns of the scan that become further dimensions, but for places and colours; ``input_NAME`` where there
            is a dimension of that name.

    Raises:
        SceneError: laspy is not installed.
    """
    laspy = need_laspy(path)
    header = laspy.LasHeader(point_format=7, version='1.4')
    low, high = (xyz.min(axis=0), xyz.max(axis=0)) if len(xyz) else (np.zeros(3), np.zeros(3))
    header.offsets = np.floor((low + high) / 2)
    header.scales = np.maximum(1e-4, np.abs(np.stack([low, high]) - header.offsets).max(axis=0) / _LAS_STEPS)
    columns = {'label': label.astype(np.int32), **(extra or {})}
    columns |= _further(kept or {}, {*columns, *map(str, header.point_format.dimension_names)})
    described = ' '.join(names)[:31]
    for name, values in columns.items():
        text = described if name == 'label' else ''
        header.add_extra_dim(laspy.ExtraBytesParams(name, values.dtype, description=text))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    las.classification = las_classes(label)
    for name, values in zip(RGB, np.round(colors.T * 65535).astype(np.uint16), strict=True):
        las[name] = values
    for name, values in columns.items():
        las[name] = values
    path = Path(path)
    return atomic_write(path, lambda file: las.write(file, do_compress=path.suffix.lower() == '.laz'))


def las_classes(label: Int[np.ndarray, ' points']) -> UInt8[np.ndarray, ' points']:
    """What ``classification`` of LAS says of classes: 64 + class, 1 where unknown or above 191."""
    known = (label >= 0) & (label < 256 - USER_DEFINED)
    classes: UInt8[np.ndarray, ' points'] = np.where(known, USER_DEFINED + label, NOT_CLASSIFIED).astype(np.uint8)
    return classes


def _further(kept: Mapping[str, np.ndarray], taken: set[str]) -> dict[str, np.ndarray]:
    """Columns of a scan under names that LAS has room for."""
    out: dict[str, np.ndarray] = {}
    for name, values in kept.items():
        if plain_name(name) in ('x', 'y', 'z', *RGB):
            continue
        free = name if name not in taken else GIVEN + name
        out[free[:_LAS_NAME]] = plain_numbers(values)
    return out
