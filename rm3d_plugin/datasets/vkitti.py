"""vKITTI 3D (point clouds of Virtual KITTI for semantic segmentation) in its native layout."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float

from rm3d_plugin.datasets.base import check_choice, not_found
from rm3d_plugin.datasets.segmentation import RawScene, SegmentationDataset, check_classes, make_cloud
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.storage.npy import read_npy
from rm3d_plugin.storage.plain_files import files_ending
from rm3d_plugin.storage.scans import has_place
from rm3d_plugin.structures import UNLABELLED, SceneError

CLASSES = (
    'terrain',
    'tree',
    'vegetation',
    'building',
    'road',
    'guardrail',
    'trafficsign',
    'trafficlight',
    'pole',
    'misc',
    'truck',
    'car',
    'van',
)
DONT_CARE = 13  # label of version 2 for points behind car windows
FOLDS = (1, 2, 3, 4, 5, 6)
Split = Literal['train', 'test']
# Frames of Virtual KITTI's sequences that make up each fold, first and last.
FRAMES = {'0001': ((0, 170, 1), (230, 420, 2)), '0002': ((0, 232, 3),), '0018': ((30, 338, 4),)} | {
    '0020': ((80, 444, 5), (500, 800, 6))
}
_LAYOUT = """
    {root}/
      01/   0001_00000.npy  0001_00012.npy ...    rows of x y z r g b label
      02/   ...
      03/  04/  05/  06/

    or, as the data set's own tools write it, by sequence: 0001/00000.npy ..., 0002/, 0018/, 0020/
"""


@DATASETS.register_module()
class VKITTI3DDataset(SegmentationDataset):
    """vKITTI 3D: one frame, one scene; six folds, 13 classes, no instances. x forward, y left, z up.

    Args:
        data_root: Folder that holds ``01`` to ``06`` (or ``0001``, ``0002``, ``0018``, ``0020``).
        split: 'test': the frames of ``test_fold``; 'train': those of the other folds.
        test_fold: 1 to 6; six-fold cross-validation takes each in turn.
        classes: Names of the 13 classes, in this order: terrain, tree, vegetation, building, road, guardrail,
            trafficsign, trafficlight, pole, misc, truck, car, van.
        common: Arguments of :class:`SegmentationDataset` and :class:`SceneDataset`.
    """

    def __init__(
        self,
        data_root: str | Path,
        split: Split = 'train',
        test_fold: int = 6,
        classes: Sequence[str] = CLASSES,
        **common: Any,
    ) -> None:
        check_choice('split', split, get_args(Split))
        if test_fold not in FOLDS:
            raise ValueError(f'test_fold: expected 1 to 6, got {test_fold!r}')
        super().__init__(split, classes=classes, **common)
        check_classes('vKITTI', self.classes, len(CLASSES))
        self.data_root = Path(data_root)
        self.test_fold = test_fold
        self._paths: tuple[Path, ...] = ()

    def find_scenes(self) -> tuple[str, ...]:
        """Frames as ``01_0001_00000`` (folder and file), by folder and name."""
        folds = find_folds(self.data_root)
        self._paths = tuple(path for path, fold in folds if (fold == self.test_fold) == (self.split == 'test'))
        if not self._paths:
            what = f'there is no frame of split {self.split!r}'
            source = 'Download it from https://github.com/VisualComputingInstitute/vkitti3D-dataset'
            raise not_found('vKITTI 3D', self.data_root, what, source, _LAYOUT, '0*/*.npy')
        return tuple(f'{path.parent.name}_{path.stem}' for path in self._paths)

    def read_scene(self, index: int) -> RawScene:
        """Points, colours and classes of a frame; "don't care" (label 13) is -1."""
        folder, _, name = self.scene_ids[index].partition('_')
        table = read_frame(self.data_root / folder / f'{name}.npy')
        colors, labels = table[:, 3:6], table[:, 6].astype(np.int64)
        scale = 255.0 if colors.max() > 1 else 1.0  # some copies hold colours from 0 to 1
        cloud = make_cloud(table[:, :3], colors=(colors / scale).astype(np.float32))
        return RawScene(cloud, np.where(labels == DONT_CARE, UNLABELLED, labels))


def find_folds(root: Path) -> list[tuple[Path, int]]:
    """Every frame with its fold: by folder (``01`` to ``06``), or by sequence and frame number.

    Folders are sequences where one is named like a sequence; frames of no fold are passed over.
    """
    folders = [path for path in sorted(root.glob('*')) if path.is_dir() and path.name.isdecimal()]
    sequences = any(path.name in FRAMES for path in folders)
    found = []
    for folder in folders:
        for path in files_ending(folder, '.npy'):
            fold = _fold_of_frame(folder.name, path.stem) if sequences else int(folder.name)
            if fold in FOLDS:
                found.append((path, fold))
    return found


def _fold_of_frame(sequence: str, frame: str) -> int:
    number = int(frame.rpartition('_')[2]) if frame.rpartition('_')[2].isdecimal() else -1
    return next((fold for first, last, fold in FRAMES.get(sequence, ()) if first <= number <= last), 0)


def read_frame(path: Path) -> Float[np.ndarray, 'points 7']:
    """Rows x, y, z, red, green, blue, label of one ``.npy`` file, float64.

    Raises:
        SceneError: The file is missing or cut off, has other columns, or a number cannot be.
    """
    if not path.is_file():
        raise SceneError(f'{path}: no such file; expected rows of x y z r g b label')
    try:
        table = read_npy(path)
    except Exception as error:  # a damaged file shows as anything from EOFError to tokenize.TokenError
        raise SceneError(f'{path}: not readable as .npy ({error}); copy it again') from error
    if table.dtype.kind not in 'iuf' or table.ndim != 2 or table.shape[1] != 7:
        raise SceneError(
            f'{path}: expected numbers of shape (N, 7), x y z r g b label, got {table.shape} of {table.dtype}'
        )
    if len(table) == 0:
        raise SceneError(f'{path}: holds no points; leave the frame out')
    table = table.astype(np.float64)
    bad = int((~(np.isfinite(table).all(axis=1) & has_place(table[:, :3]))).sum())
    if bad:
        raise SceneError(f'{path}: {bad} of {len(table)} rows hold NaN or infinite numbers; drop them first')
    _check_range(path, 'r, g, b', table[:, 3:6], 255, whole=False)
    _check_range(path, 'label', table[:, 6:], DONT_CARE, whole=True)
    return table


def _check_range(path: Path, field: str, values: np.ndarray, most: int, whole: bool) -> None:
    wrong = (values < 0) | (values > most) | (whole & (values % 1 != 0))
    if wrong.any():
        row = int(np.argwhere(wrong)[0, 0])
        kind = 'a whole number from 0' if whole else '0'
        raise SceneError(f'{path}, row {row}: {field}: expected {kind} to {most}, got {values[wrong][0]:g}')
