"""Scans of one's own with boxes from a labelling tool."""

import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from rm3d_plugin.class_names import one_spelling
from rm3d_plugin.datasets.base import DatasetNotFoundError, check_choice
from rm3d_plugin.datasets.box_formats import BOX_FORMATS, LABELCLOUD_CLASSES, find_format, labelcloud_format
from rm3d_plugin.datasets.boxes import BoxDataset, in_units, to_units
from rm3d_plugin.datasets.files import FilesDataset
from rm3d_plugin.datasets.kitti_format import KittiCalib, read_calib
from rm3d_plugin.datasets.named_boxes import BoxFileError, NamedBoxes
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.storage.columns import ENDINGS, Columns
from rm3d_plugin.storage.plain_files import read_list
from rm3d_plugin.storage.scans import NanPoints
from rm3d_plugin.storage.written_files import real_path
from rm3d_plugin.structures import Boxes3D, PointCloud, SceneError

Split = Literal['train', 'val', 'test']
SCANS = ('points', 'velodyne', 'pointclouds', 'lidar', 'scans')
BOXES = ('labels', 'label_2', 'label', 'boxes')
BOX_ENDINGS = ('.txt', '.json')
_LAYOUT = """
    {root}/
      train.txt  val.txt      names of scans, one a line (or ImageSets/train.txt, or folders train/ and val/)
      points/                 one scan a file: {endings} (or velodyne/, pointclouds/, lidar/, scans/)
      labels/                 NAME.txt or NAME.json for the scan NAME (or label_2/, label/, boxes/): OpenPCDet, KITTI,
                              labelCloud, SUSTechPOINTS; an empty file: there is no object; no file: nobody labelled it
      calib/                  NAME.txt, for KITTI's boxes alone
"""


class Layout(NamedTuple):
    """Where the files of a split are.

    Attributes:
        scans: Folder of the scans.
        boxes: Folder of the boxes.
        calib: Folder of KITTI's calibrations.
        names: Of the scans, with or without ending, or None: all there are.
    """

    scans: Path
    boxes: Path
    calib: Path
    names: tuple[str, ...] | None


@DATASETS.register_module()
class BoxFilesDataset(BoxDataset):
    """Scans in files of the usual kinds with boxes beside them: one file, one scene.

    Large coordinates lose nothing: a scan far from zero has its own local frame, and its boxes move with it. A scan
    without a file of boxes is one that nobody labelled: training may use it, a metric may not.

    Args:
        data_root: Folder of the data; see :data:`_LAYOUT`.
        split: Names the list or the folder.
        ann_file: List of names, one a line, relative to ``data_root``; None: ``SPLIT.txt`` or ``ImageSets/SPLIT.txt``
            where there is one.
        classes: Classes to learn, in the order of their numbers; boxes of others are left out. None: all that
            the split's folder has, by name.
        unit: Metres that count as one to everything that follows: points and boxes are divided by it, so that boats or
            insects are to a network what cars are. None: 1.
        box_format: A key of :data:`~rm3d_plugin.datasets.box_formats.BOX_FORMATS`; 'auto': told from the files.
        columns: See :class:`FilesDataset`.
        nan_points: See :class:`FilesDataset`; 'drop' leaves out what a lidar stores where nothing came back.
        cache: See :class:`FilesDataset`.
        common: Arguments of :class:`BoxDataset` and :class:`SceneDataset`.

    Raises:
        DatasetNotFoundError: Nothing is there.
        BoxFileError: Boxes cannot be read.
    """

    def __init__(
        self,
        data_root: str | Path,
        split: Split = 'train',
        ann_file: str | None = None,
        classes: Sequence[str] | None = None,
        box_format: str = 'auto',
        unit: float | None = None,
        columns: str | Columns | None = None,
        nan_points: NanPoints = 'drop',
        cache: str | Path | None = 'work_dirs/scene_cache',
        **common: Any,
    ) -> None:
        check_choice('split', split, get_args(Split))
        check_choice('box_format', box_format, ('auto', *BOX_FORMATS))
        super().__init__(split, classes=classes or (), **common)
        if unit is not None and not 0 < unit < np.inf:
            raise ValueError(f'unit: expected metres above 0, got {unit}')
        self.data_root = Path(data_root)
        self.ann_file = ann_file
        self.unit = unit or 1.0
        self._given_format = box_format
        self._split: Split = split
        self._reading: dict[str, Any] = {'columns': columns, 'nan_points': nan_points, 'cache': cache}
        self._scans: FilesDataset | None = None
        self._layout: Layout | None = None
        self._box_format: str | None = None
        self._box_files: list[Path] | None = None
        if not self.classes and self.data_root.is_dir():
            self.classes = self.find_classes()

    # ------------------------------------------------------------------ scenes

    @property
    def layout(self) -> Layout:
        """Where the files are; looked up at first use."""
        if self._layout is None:
            self._layout = find_layout(self.data_root, self.split, self.ann_file)
        return self._layout

    @property
    def scans(self) -> FilesDataset:
        """The scans alone."""
        if self._scans is None:
            folder, names = self.layout.scans, self.layout.names
            files = None if names is None else _scans_of(folder, names)
            self._scans = FilesDataset(folder, self._split, files=files, **self._reading)
        return self._scans

    def find_scenes(self) -> tuple[str, ...]:
        """Names of the scans without their ending.

        Raises:
            BoxFileError: With labels='truth', nobody labelled one of them.
        """
        names = self.scans.scene_ids
        if self.labels == 'truth' and self.bad_scenes == 'error':
            for name in names:
                self._labelled_file(name)
        return names

    def box_files(self) -> list[Path]:
        """Every file of boxes of the data set, of all splits that share the folder."""
        folder = self.layout.boxes
        if folder == self.layout.scans:  # text may be scans there
            own = (self._beside(name, '.json') for name in self.scans.scene_ids)
            return [path for path in own if path.is_file()]
        if self._box_files is None:
            there = sorted(path for path in _visible_below(folder) if path.suffix.lower() in BOX_ENDINGS)
            there = [path for path in there if path.name != LABELCLOUD_CLASSES]
            scans = {_stem(path, self.layout.scans) for path in _visible_below(self.layout.scans)}
            known = [_stem(path, folder) in scans for path in there]
            self._box_files = _of_scans(there, known, folder, self.layout.scans)
        return self._box_files

    @property
    def box_format(self) -> str:
        """Format of the boxes, told from all files at first use."""
        if self._box_format is None:
            self._box_format = self._given_format
            if self._given_format == 'auto':
                self._box_format = find_format(self.box_files(), labelcloud_format(self.layout.boxes))
        return self._box_format

    def find_classes(self) -> tuple[str, ...]:
        """Names of all classes that a box of any split has, sorted, each in one spelling."""
        return one_spelling(sorted({name for path in self.box_files() for name in self._named(path).names}))

    # ------------------------------------------------------------------ one scene

    def read_cloud(self, index: int) -> PointCloud:
        """Every point of a file."""
        self.full_init()  # scenes may be left out
        return in_units(self.scans.load_cloud(self.scans.scene_ids.index(self.scene_ids[index])), self.unit)

    def is_labelled(self, index: int) -> bool:
        """Whether there is a file of boxes."""
        return self._box_file(self.scene_ids[index]) is not None

    def read_boxes(self, index: int, cloud: PointCloud) -> Boxes3D:
        """Boxes of the classes, moved into the frame of the scan's points."""
        path = self._labelled_file(self.scene_ids[index])
        boxes = to_units(self._named(path).of_classes(self.classes), np.asarray(cloud.origin), self.unit)
        _warn_of_another_frame(boxes, cloud, path)
        return boxes

    def _labelled_file(self, name: str) -> Path:
        path = self._box_file(name)
        if path is None:
            expected = self._beside(name, BOX_FORMATS[self.box_format].ending)
            raise BoxFileError(
                f'scene {name}: nobody labelled it, there is no {expected}; an empty file says: no object; '
                'or take the scan off the list'
            )
        return path

    def _named(self, path: Path) -> NamedBoxes:
        return BOX_FORMATS[self.box_format].read(path, self._calib(path.stem))

    def _calib(self, name: str) -> KittiCalib | None:
        path = self.layout.calib / f'{name}.txt'
        return read_calib(path) if self.box_format == 'kitti' and path.is_file() else None

    def _box_file(self, name: str) -> Path | None:
        path = self._beside(name, BOX_FORMATS[self.box_format].ending)
        return path if _is_there(path) and path != self._scan(name) else None

    def _scan(self, name: str) -> Path:
        return self.scans.path(self.scans.scene_ids.index(name))

    def _beside(self, name: str, ending: str) -> Path:
        """Where the boxes of a scan are looked for."""
        return self.layout.boxes / self._scan(name).relative_to(self.layout.scans).with_suffix(ending)


def find_layout(root: Path, split: str, ann_file: str | None = None) -> Layout:
    """Where scans, boxes and the list of a split are; see :data:`_LAYOUT`.

    Raises:
        DatasetNotFoundError: The folder or the list is not there, or nothing says which scans are for validation.
    """
    if not root.is_dir():
        raise _not_found(root, 'there is no such folder')
    names = _names(root, split, ann_file)
    bases = [root / split, root / 'training', root]
    base = next(path for path in bases if path.is_dir())
    if split != 'train' and names is None and base != bases[0]:
        raise _not_found(root, f'nothing tells the scans of split {split!r}: there is no list and no such folder')
    scans = next((base / name for name in SCANS if (base / name).is_dir()), base)
    boxes = next((base / name for name in BOXES if (base / name).is_dir()), scans)
    return Layout(scans, boxes, base / 'calib', names)


def _names(root: Path, split: str, ann_file: str | None) -> tuple[str, ...] | None:
    usual = (root / f'{split}.txt', root / 'ImageSets' / f'{split}.txt')
    path = root / ann_file if ann_file is not None else next((path for path in usual if path.is_file()), None)
    if path is None:
        return None
    if not path.is_file():
        raise _not_found(root, f'there is no list {path}')
    names = tuple(read_list(path))
    if not names or len(set(names)) < len(names):
        raise SceneError(
            f'{path}: {len(names)} scans, {len(names) - len(set(names))} of them twice; list each scan once'
        )
    return names


def _visible_below(folder: Path) -> Iterator[Path]:
    """Files of a folder and those in it, hidden ones left out."""
    for path in folder.rglob('*'):
        if _is_there(path) and not any(part.startswith('.') for part in path.relative_to(folder).parts):
            yield path


def _warn_of_another_frame(boxes: Boxes3D, cloud: PointCloud, path: Path) -> None:
    """A warning where all boxes are farther from the points than these are from each other."""
    low, high = cloud.xyz.min(axis=0), cloud.xyz.max(axis=0)
    gap = np.maximum(low - boxes.tensor[:, :3], boxes.tensor[:, :3] - high).max(axis=1, initial=-np.inf)
    if len(gap) and (gap > (high - low).max() + boxes.tensor[:, 3:6].max(axis=1)).all():
        warnings.warn(
            f'{path}: all {len(gap)} boxes are farther from the points than the scan is wide; are they in the '
            'coordinates of its file?',
            stacklevel=3,
        )


def _is_there(path: Path) -> bool:
    """Whether there is a file, or a link that leads to none: what is read then tells it."""
    return path.is_file() or path.is_symlink()


def _stem(path: Path, folder: Path) -> Path:
    return path.relative_to(folder).with_suffix('')


def _of_scans(paths: list[Path], has_scan: list[bool], folder: Path, scans: Path) -> list[Path]:
    """The files of boxes that belong to a scan; others are told.

    Raises:
        BoxFileError: None does, or an ending is spelled in large letters: the file would be passed over.
    """
    strange = [path for path, known in zip(paths, has_scan, strict=True) if not known]
    found = [path for path, known in zip(paths, has_scan, strict=True) if known]
    large = [path for path in found if path.suffix not in BOX_ENDINGS]
    if large:
        raise BoxFileError(f'{large[0]}: expected an ending in small letters; rename the file')
    if strange and not found:
        raise BoxFileError(
            f'{strange[0]}: there is no scan of that name in {scans}, nor of any other file of {folder}: name boxes '
            'like their scans'
        )
    if strange:
        warnings.warn(
            f'{folder}: {len(strange)} of {len(paths)} files are passed over, since {scans} has no scan of their name; '
            f'the first is {strange[0].name}',
            stacklevel=4,
        )
    return found


def _scans_of(folder: Path, names: Sequence[str]) -> list[str]:
    """The files of listed names, relative to the folder; each folder of theirs is looked through once."""
    there: dict[Path, dict[str, list[str]]] = {}
    found = []
    for name in names:
        path = folder / name
        if path.suffix.lower() in ENDINGS:
            found.append(name)
            continue
        if path.parent not in there:
            there[path.parent] = _scans_by_stem(path.parent)
        files = there[path.parent].get(path.name, [])
        if not files:
            raise SceneError(f'{folder}: there is no scan {name} ({" ".join(ENDINGS)}), but the list names it')
        if len(files) > 1:
            raise SceneError(f'{folder}: the list names {name}, which may be {" or ".join(files)}; give it its ending')
        found.append(str(Path(name).parent / files[0]))
    return found


def _scans_by_stem(folder: Path) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for path in sorted(folder.iterdir() if folder.is_dir() else ()):
        if path.suffix.lower() in ENDINGS:
            found.setdefault(path.stem, []).append(path.name)
    return found


def _not_found(root: Path, what: str) -> DatasetNotFoundError:
    layout = _LAYOUT.format(root=real_path(root), endings=' '.join(ENDINGS))
    return DatasetNotFoundError(
        f'Scans with boxes were looked for at {real_path(root)}, but {what}. Lay them out so:\n{layout}'
    )
