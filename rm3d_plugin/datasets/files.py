"""Any folder of scans, with or without labels."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Literal, get_args

import numpy as np

from rm3d_plugin.class_names import class_index
from rm3d_plugin.datasets.base import DatasetNotFoundError, check_choice
from rm3d_plugin.datasets.segmentation import RawScene, SegmentationDataset, numbers_of_things, only_things
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.storage.columns import ENDINGS, Columns
from rm3d_plugin.storage.plain_files import read_list
from rm3d_plugin.storage.scans import COLOR_RANGES, ColorRange, NanPoints, Scan, map_labels, read_scan
from rm3d_plugin.storage.written_files import real_path
from rm3d_plugin.structures import UNLABELLED, PointCloud, SceneError

Split = Literal['train', 'val', 'test']
OtherLabels = Literal['error', 'ignore']
SLOW = ('.txt', '.xyz', '.csv', '.laz', '.pts', '.ptx', '.e57', '.xyz_label_conf')  # worth a cache
_LAYOUT = """
    {root}/
      train/   one scan a file, in any sub-folders: {endings}
      val/
      test/

    or all scans in {root} itself, with ann_file= a list of those of the split, or files= patterns
"""


@DATASETS.register_module()
class FilesDataset(SegmentationDataset):
    """Scans in files of the usual kinds: one file, one scene; labels where the files have them.

    Large coordinates (UTM, say) lose nothing: each scan has its own local frame, and ``load_cloud(i).origin`` tells
    where it lies.

    Args:
        data_root: Folder of the scans.
        split: Reads the folder of that name in ``data_root`` where there is one, else ``data_root``.
        files: Which files: a pattern (``'**/*.ply'``), or patterns and paths, relative to that folder; None: every file
            of a known kind, in sub-folders too.
        ann_file: List of file names, one a line, relative to ``data_root``; in place of ``files``.
        classes: Class names; (): the scans have no labels, or none that are wanted.
        things: Names of the classes that have instances; these come from the column ``instance``.
        columns: See :func:`rm3d_plugin.storage.scans.read_scan`: ``dict(label='classification')``, say, or
            ``dict(x=0, y=1, z=2, label=6)``.
        label_map: Raw label -> name or number of a class, or -1 = ignored; None: raw labels are class numbers.
        other_labels: What becomes of labels that ``label_map`` does not list: an error, or ignored.
        color_range: See :func:`rm3d_plugin.storage.scans.read_scan`; state it for dark scans in 16-bit colours.
        intensity_range: Least and greatest intensity, which become 0 and 1; what lies outside is clipped. One number:
            the greatest, above 0. None: as in the file.
        nan_points: See :func:`rm3d_plugin.storage.scans.read_scan`; 'drop' leaves out what organised PCD holds where
            nothing came back. Clicks by number then count the points that are kept.
        cache: See :class:`SegmentationDataset`; text and LAZ are kept there.
        common: Arguments of :class:`SegmentationDataset` and :class:`SceneDataset`.
    """

    alike: ClassVar[bool] = False

    def __init__(
        self,
        data_root: str | Path,
        split: Split = 'train',
        files: str | Sequence[str] | None = None,
        ann_file: str | None = None,
        classes: Sequence[str] = (),
        things: Sequence[str] = (),
        columns: str | Columns | None = None,
        label_map: Mapping[int | str, int | str] | None = None,
        other_labels: OtherLabels = 'error',
        color_range: ColorRange = 'auto',
        intensity_range: float | Sequence[float] | None = None,
        nan_points: NanPoints = 'error',
        cache: str | Path | None = 'work_dirs/scene_cache',
        **common: Any,
    ) -> None:
        check_choice('split', split, get_args(Split))
        check_choice('other_labels', other_labels, get_args(OtherLabels))
        check_choice('nan_points', nan_points, get_args(NanPoints))
        check_choice('color_range', color_range, COLOR_RANGES)
        super().__init__(split, cache=cache, classes=classes, **common)
        if files is not None and ann_file is not None:
            raise ValueError('files and ann_file: expected one of them, got both')
        self.data_root = Path(data_root)
        self.files = [files] if isinstance(files, str) else files
        self.ann_file = None if ann_file is None else self.data_root / ann_file
        self._thing_classes = numbers_of_things(things, self.classes)
        self.columns = columns
        self.label_map = None if label_map is None else class_numbers(label_map, self.classes)
        self.other_labels: OtherLabels = other_labels
        self.color_range = color_range
        self.intensity_range = None if intensity_range is None else intensity_limits(intensity_range)
        self.nan_points: NanPoints = nan_points
        self._paths: dict[str, Path] = {}

    # ------------------------------------------------------------------ scenes

    def find_scenes(self) -> tuple[str, ...]:
        """Names of the files without their ending, sub-folders joined by ``_``; with the ending where two are alike."""
        folder, paths = self._find_files()
        names = ['_'.join(_relative(path, folder).with_suffix('').parts) for path in paths]
        alike = Counter(names)
        names = [name + path.suffix if alike[name] > 1 else name for name, path in zip(names, paths, strict=True)]
        if len(set(names)) < len(names):
            doubled = Counter(names).most_common(1)[0][0]
            raise SceneError(f'{folder}: two scans are named {doubled}; rename one, or list each once')
        self._paths = dict(zip(names, paths, strict=True))
        return tuple(names)

    def _find_files(self) -> tuple[Path, list[Path]]:
        """The folder that names are relative to, and the scans in their order."""
        if self.ann_file is not None:
            if not self.ann_file.is_file():
                raise DatasetNotFoundError(self._not_found(f'there is no list {self.ann_file}'))
            if not (names := read_list(self.ann_file)):
                raise SceneError(f'{self.ann_file}: names no scan; list one a line, relative to {self.data_root}')
            return self.data_root, [self.data_root / name for name in names]
        inside = self.data_root / self.split
        folder = inside if inside.is_dir() else self.data_root
        found: list[Path] = []
        for pattern in ['**/*'] if self.files is None else self.files:
            if any(letter in pattern for letter in '*?['):
                found += sorted(path for path in folder.glob(pattern) if _is_scan(path, folder))
            else:
                found.append(folder / pattern)
        if not found:
            what = 'no scan' if self.files is None else f'no scan that fits {", ".join(self.files)}'
            raise DatasetNotFoundError(self._not_found(f'there is {what} in {folder}'))
        return folder, list(dict.fromkeys(found))

    def _not_found(self, what: str) -> str:
        layout = _LAYOUT.format(root=real_path(self.data_root), endings=' '.join(ENDINGS))
        return f'Scans were looked for at {real_path(self.data_root)}, but {what}. Lay them out so:\n{layout}'

    def path(self, index: int) -> Path:
        """The file of a scene."""
        name = self.scene_ids[index]  # finds the files first
        return self._paths[name]

    # ------------------------------------------------------------------ one scene

    @property
    def thing_classes(self) -> tuple[int, ...]:
        """Numbers of ``things``."""
        return self._thing_classes

    def read_scene(self, index: int) -> RawScene:
        """Every point of a file, and its labels where there are ``classes`` and a column of labels."""
        scan = self._scan(self.path(index))
        cloud = self._with_intensity(scan.cloud)
        if scan.label is None:
            return RawScene(cloud)
        path = self.path(index)
        semantic = map_labels(scan.label, len(self.classes), self.label_map, path, self.other_labels)
        if scan.instance is None or not self.thing_classes:
            return RawScene(cloud, semantic)
        return RawScene(cloud, semantic, only_things(scan.instance, semantic, self.thing_classes))

    def why_no_truth(self, index: int) -> str:
        """What a file lacks."""
        if not self.classes:
            return "labels are asked for, but classes is empty; pass classes=('ground', 'tree', ...)"
        return f"{self.path(index)}: has no column label; name it, columns=dict(label='...')"

    def _scan(self, path: Path) -> Scan:
        options: dict[str, Any] = {'columns': self.columns, 'color_range': self.color_range}
        options |= {'labels': len(self.classes) > 0, 'nan_points': self.nan_points}
        if path.suffix.lower() not in SLOW or not path.is_file():
            return read_scan(path, **options)
        return Scan.from_arrays(self.parsed('files', (path,), lambda: read_scan(path, **options).to_arrays(), options))

    def _with_intensity(self, cloud: PointCloud) -> PointCloud:
        if self.intensity_range is None or cloud.intensity is None:
            return cloud
        channels = {
            name: getattr(cloud, name) for name in ('xyz', 'colors', 'normals', 'curvature', 'origin', 'sensor')
        }
        low, high = self.intensity_range
        intensity = ((cloud.intensity - np.float32(low)) / np.float32(high - low)).clip(0.0, 1.0)
        return PointCloud(intensity=intensity, **channels)


def intensity_limits(given: float | Sequence[float]) -> tuple[float, float]:
    """Least and greatest intensity, of a pair or of the greatest alone.

    Raises:
        ValueError: The greatest is not above the least.
    """
    limits = (0.0, given) if isinstance(given, int | float) else tuple(given)
    if not (len(limits) == 2 and all(isinstance(limit, int | float) for limit in limits) and limits[0] < limits[1]):
        raise ValueError(f'intensity_range: expected a number > 0, or a pair LOW < HIGH, got {given}')
    return float(limits[0]), float(limits[1])


def class_numbers(label_map: Mapping[int | str, int | str], classes: tuple[str, ...]) -> dict[int, int]:
    """Raw label -> class number; raw labels may be text, as they are after a way through JSON.

    Raises:
        ValueError: A raw label is no whole number, or a class is not one of ``classes``.
    """
    out = {}
    for raw, target in label_map.items():
        number = class_index(target, classes) if isinstance(target, str) else target
        if not isinstance(number, int) or not UNLABELLED <= number < len(classes):
            raise ValueError(f'label_map[{raw!r}]: expected one of {", ".join(classes)}, or -1, got {target!r}')
        try:
            out[int(raw)] = number
        except ValueError:
            raise ValueError(f'label_map: raw label {raw!r}: expected a whole number') from None
    return out


def _is_scan(path: Path, folder: Path) -> bool:
    hidden = any(part.startswith('.') for part in path.relative_to(folder).parts)
    there = path.is_file() or path.is_symlink()  # a link to nothing is told when it is read
    return there and path.suffix.lower() in ENDINGS and not hidden


def _relative(path: Path, folder: Path) -> Path:
    return path.relative_to(folder) if path.is_relative_to(folder) else Path(path.name)
