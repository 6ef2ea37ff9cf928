"""Lists that others drew: points for each scene (ScanNet's data-efficient benchmark), or scenes labelled completely."""

import re
import zipfile
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from rm3d_plugin.label_budgets.base import BudgetError
from rm3d_plugin.label_budgets.point_amount import PointAmount
from rm3d_plugin.label_budgets.points import PointBudget, RowsOf, TruthOf, collect_budget
from rm3d_plugin.storage.files import read_json
from rm3d_plugin.storage.npy import read_archive
from rm3d_plugin.storage.plain_files import read_text

# What a saved mapping of names to index arrays may be made of, by the old and the new name of numpy's core.
_ARRAY_PARTS = ('_reconstruct', 'scalar')
_FILE_WORDS = re.compile(r'(_vh_clean_2)?(\.labels)?(\.\w+)?$')


def import_point_list(
    scene_ids: Sequence[str], truth_of: TruthOf, amount: PointAmount, seed: int, rows_of: RowsOf | None = None
) -> PointBudget:
    """The budget that the ``point_list`` or ``scene_list`` of an amount says.

    Args:
        scene_ids: Names of all scenes; those that the list lacks show nothing.
        truth_of: The truth of a scene; each is asked for once.
        amount: Names the file.
        seed: Kept with the budget; of no other effect.
        rows_of: For a voxel-downsampled scene, the row of its points that stands for each point of the original file,
            which the list counts.

    Raises:
        BudgetError: The file cannot be used, or names none of the scenes, or a point that a scene does not have.
    """
    if amount.scene_list is not None:
        listed = read_scene_list(amount.scene_list)
        complete = frozenset(listed) & frozenset(scene_ids)
        _need_some(amount.scene_list, complete, listed, scene_ids)
        return collect_budget(scene_ids, truth_of, _nothing, complete, amount, seed)
    assert amount.point_list is not None
    points = read_point_list(amount.point_list)
    _need_some(amount.point_list, set(points) & set(scene_ids), list(points), scene_ids)

    def choose(scene: str, semantic: np.ndarray, instance: np.ndarray) -> np.ndarray:
        listed = points.get(scene, np.zeros(0, dtype=np.int64))
        rows = np.arange(len(semantic)) if rows_of is None else rows_of(scene)
        if len(listed) and (listed.min() < 0 or listed.max() >= len(rows)):
            raise BudgetError(
                f'{amount.point_list}: scene {scene} has the points 0..{len(rows) - 1}, but the list names '
                f'{listed.min() if listed.min() < 0 else listed.max()}; is it a list for these files?'
            )
        return np.unique(rows[listed])

    return collect_budget(scene_ids, truth_of, choose, (), amount, seed)


def read_point_list(path: str | Path) -> dict[str, Int[np.ndarray, ' _points']]:
    """Scene -> point numbers, from ``.pth`` or ``.pt`` (torch), ``.npz`` (an array a scene) or ``.json``.

    A file without one of these endings is read as torch's, as ScanNet's lists ``points20`` ... ``points200`` are.
    Scene names lose folder and ending, so that ``scans/scene0000_00_vh_clean_2.ply`` means ``scene0000_00``.

    Raises:
        BudgetError: The file is missing or holds anything but arrays of whole numbers by scene.
    """
    path = Path(path)
    if not path.is_file():
        raise BudgetError(f'{path}: no such list of points')
    try:
        content = _load(path)
    except Exception as error:  # damage shows as anything from struct.error to UnpicklingError
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise BudgetError(
            f'{path}: not readable as a list of points ({reason}); expected .pth, .npz or .json '
            'with an array of point numbers for each scene'
        ) from error
    if not isinstance(content, Mapping):
        raise BudgetError(f'{path}: expected a mapping of scenes to point numbers, got {type(content).__name__}')
    found: dict[str, Int[np.ndarray, ' _points']] = {}
    for name, rows in content.items():
        scene = scene_name(str(name))
        if scene in found:
            raise BudgetError(f'{path}: two lists for the scene {scene} (the second is {name!r}); join them')
        found[scene] = _indices(path, name, rows)
    return found


def read_scene_list(path: str | Path) -> list[str]:
    """Names of a text file, one a line, without folder and ending; they may have blanks.

    Raises:
        BudgetError: The file is missing or names nothing.
    """
    try:
        lines = [line.strip() for line in read_text(Path(path)).split('\n') if line.strip()]
    except FileNotFoundError:
        raise BudgetError(f'{path}: no such list of scenes') from None
    if not lines:
        raise BudgetError(f'{path}: names no scene')
    return [scene_name(line) for line in lines]


def scene_name(text: str) -> str:
    """A scene's name out of a file name.

    >>> scene_name('scans/scene0000_00_vh_clean_2.labels.ply')
    'scene0000_00'
    >>> scene_name('Area_1_office_3')
    'Area_1_office_3'
    """
    return _FILE_WORDS.sub('', text.replace('\\', '/').rpartition('/')[2])


def _load(path: Path) -> Any:
    if path.suffix == '.json':
        return read_json(path)
    if path.suffix in ('.npz', '.npy'):
        if not zipfile.is_zipfile(path):
            raise ValueError('an .npy file holds one array; numpy.savez(NAME, **lists) makes an .npz of a mapping')
        return read_archive(path)
    return _load_torch(path)


def _load_torch(path: Path) -> Any:
    """Read with nothing allowed but tensors, arrays and plain containers: no code of the file runs."""
    import torch  # costs seconds, and only this format needs it

    core = import_module('numpy._core.multiarray')
    allowed: list[Any] = [
        np.ndarray,
        np.dtype,
        *{type(np.dtype(kind)) for kind in ('i1', 'i2', 'i4', 'i8', 'u1', 'u2', 'u4', 'u8')},
    ]
    for part in _ARRAY_PARTS:
        allowed += [(getattr(core, part), f'{module}.multiarray.{part}') for module in ('numpy.core', 'numpy._core')]
    with torch.serialization.safe_globals(allowed):
        return torch.load(path, map_location='cpu', weights_only=True)


def _indices(path: Path, scene: Any, rows: Any) -> Int[np.ndarray, ' points']:
    values = np.asarray(rows)
    if values.size == 0:
        return np.zeros(0, dtype=np.int64)
    if values.ndim != 1 or not np.issubdtype(values.dtype, np.integer):
        raise BudgetError(
            f'{path}: scene {scene}: expected one row of whole numbers, got {values.dtype} of shape {values.shape}'
        )
    return values.astype(np.int64)


def _need_some(path: str, used: object, listed: Sequence[str], scene_ids: Sequence[str]) -> None:
    if not used:
        raise BudgetError(
            f'{path}: names none of the {len(scene_ids)} scenes; it names {", ".join(listed[:3])} ..., the data set '
            f'has {", ".join(list(scene_ids)[:3])} ...'
        )


def _nothing(scene: str, semantic: np.ndarray, instance: np.ndarray) -> np.ndarray:
    return np.zeros(0, dtype=np.int64)
