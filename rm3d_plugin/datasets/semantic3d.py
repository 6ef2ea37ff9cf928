"""Semantic3D in its native layout."""

import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Int

from rm3d_plugin.datasets.base import DatasetNotFoundError, check_choice, not_found
from rm3d_plugin.datasets.downsampled import check_voxel
from rm3d_plugin.datasets.segmentation import RawScene, SegmentationDataset, check_classes, file_key, make_cloud
from rm3d_plugin.datasets.semantic3d_format import CLASSES, thin_scene
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.storage.files import DamagedFileError, read_npz, write_npz
from rm3d_plugin.storage.plain_files import files_ending, visible
from rm3d_plugin.structures import SceneError

Split = Literal['train', 'val', 'trainval', 'test']
Benchmark = Literal['semantic-8', 'reduced-8']
TRAINING = (
    'bildstein_station1', 'bildstein_station3', 'bildstein_station5', 'domfountain_station1', 'domfountain_station2',
    'domfountain_station3', 'neugasse_station1', 'sg27_station1', 'sg27_station2', 'sg27_station4', 'sg27_station5',
    'sg27_station9', 'sg28_station4', 'untermaederbrunnen_station1', 'untermaederbrunnen_station3',
)  # fmt: skip
TESTING: dict[str, tuple[str, ...]] = {
    'semantic-8': (
        'birdfountain_station1', 'castleblatten_station1', 'castleblatten_station5', 'marketplacefeldkirch_station1',
        'marketplacefeldkirch_station4', 'marketplacefeldkirch_station7', 'sg27_station3', 'sg27_station6',
        'sg27_station8', 'sg27_station10', 'sg28_station2', 'sg28_station5', 'stgallencathedral_station1',
        'stgallencathedral_station3', 'stgallencathedral_station6',
    ),
    'reduced-8': (
        'marketplacefeldkirch_station4', 'sg27_station10', 'sg28_station2', 'stgallencathedral_station6',
    ),
}  # fmt: skip
HOLDOUT = ('bildstein_station5', 'domfountain_station3', 'sg27_station9')
_LAYOUT = """
    {root}/                                  (or folders in it)
      bildstein_station1_xyz_intensity_rgb.txt      x y z intensity r g b
      bildstein_station1_xyz_intensity_rgb.labels   0 unlabelled, 1 to 8 (training stations)
      ...
"""


@DATASETS.register_module()
class Semantic3DDataset(SegmentationDataset):
    """Semantic3D: one station, one scene; metres, z up, colour and intensity, no instances.

    A station has up to 10^8 points. Its text is read in pieces, and the first point of each voxel stays, with the class
    that most labelled points of the voxel have. Predictions go back to every line of the file through
    :meth:`original_index`, or piece by piece through :meth:`original_pieces`.

    Args:
        data_root: Folder of the ``.txt`` and ``.labels`` files; they may lie in folders of it.
        split: 'trainval' is the benchmark's 15 training stations, 'val' is ``holdout``, 'train' is the others of them;
            'test' is the benchmark's and has no labels.
        benchmark: 'semantic-8' (15 test stations) or 'reduced-8' (4, thinned by the benchmark).
        stations: Take these instead of the split's, each of which must be there.
        holdout: Training stations to measure on; the benchmark itself names none.
        voxel_downsample: Edge of a voxel, metres. Larger: fewer points.
        classes: Names of the eight classes; their order is fixed.
        common: Arguments of :class:`SegmentationDataset` (``cache``: where the thinned scenes are kept) and
            :class:`SceneDataset`.

    Raises:
        DatasetNotFoundError: Stations are not there.
        ValueError: A choice that there is not.
    """

    def __init__(
        self,
        data_root: str | Path,
        split: Split = 'train',
        benchmark: Benchmark = 'semantic-8',
        stations: Sequence[str] | None = None,
        holdout: Sequence[str] = HOLDOUT,
        voxel_downsample: float = 0.05,
        classes: Sequence[str] = CLASSES,
        **common: Any,
    ) -> None:
        check_choice('split', split, get_args(Split))
        check_choice('benchmark', benchmark, get_args(Benchmark))
        super().__init__(split, classes=classes, **common)  # scenes come thinned
        check_classes('Semantic3D', self.classes, len(CLASSES))
        if unknown := sorted(set(holdout) - set(TRAINING)):
            raise ValueError(f'holdout: expected training stations, got {", ".join(unknown)}')
        self.data_root = Path(data_root)
        self.benchmark = benchmark
        if isinstance(stations, str):
            raise ValueError(f'stations: expected a list of names, got {stations!r}')
        self.stations = None if stations is None else tuple(stations)
        if self.stations is not None and len(set(self.stations)) < len(self.stations):
            raise ValueError(f'stations: name each once, got {list(self.stations)}')
        self.holdout = tuple(holdout)
        self.edge = check_voxel(voxel_downsample)
        self._rows: tuple[int, list[np.ndarray]] | None = None  # of the scene read last, where there is no cache

    # ------------------------------------------------------------------ scenes

    def find_scenes(self) -> tuple[str, ...]:
        """Stations, in the order of the split or of ``stations``."""
        wanted = self._wanted()
        missing = [station for station in wanted if self._find(station, '.txt') is None]
        if missing and (self.stations is not None or len(missing) == len(wanted)):
            raise self._not_found(missing)
        if missing:
            warnings.warn(
                f'{self.data_root}: {len(missing)} of {len(wanted)} stations of split {self.split!r} are not there and '
                f'left out: {", ".join(missing)}; stations=[...] says which to take',
                stacklevel=2,
            )
        return tuple(station for station in wanted if station not in missing)

    def _wanted(self) -> tuple[str, ...]:
        if self.stations is not None:
            return self.stations
        if self.split == 'test':
            return TESTING[self.benchmark]
        if self.split == 'val':
            return self.holdout
        return tuple(name for name in TRAINING if self.split == 'trainval' or name not in self.holdout)

    def _find(self, station: str, ending: str) -> Path | None:
        """The file of a station: ``STATION.txt`` or ``STATION_xyz_intensity_rgb.txt``, in any case of letters."""
        reduced = self.benchmark == 'reduced-8' and self.split == 'test'
        folders = [self.data_root, *(path for path in sorted(visible(self.data_root.glob('*'))) if path.is_dir())]
        found = []
        for path in (path for folder in folders for path in files_ending(folder, ending, large=True)):
            stem = path.stem.lower()
            if f'{stem}_'.startswith(f'{station.lower()}_') and ('reduced' in stem) == reduced:
                found.append(path)
        if len(found) > 1:
            raise SceneError(f'{found[1]}: a second file of {station} beside {found[0]}; keep one of them')
        return found[0] if found else None

    def _not_found(self, missing: list[str]) -> DatasetNotFoundError:
        what = f'there is no {", ".join(missing[:3])}{" ..." if len(missing) > 3 else ""}'
        return not_found(
            'Semantic3D', self.data_root, what, 'Download it from http://www.semantic3d.net', _LAYOUT, '*station*.txt'
        )

    # ------------------------------------------------------------------ one scene

    def read_scene(self, index: int) -> RawScene:
        """The thinned points of a station, with classes where there is a label file; slow once, then cached."""
        points, labels = self._files(index)
        if self.cache is None:
            rows: list[np.ndarray] = []
            arrays = self._thin(index, lambda piece: rows.append(piece.astype(np.int32)))
            self._rows = index, rows
        else:
            arrays = self.cache.get_or_make(self._key(index), lambda: self._thin_into_cache(index))
        channels = {name: arrays[name] for name in ('colors', 'intensity')}
        return RawScene(make_cloud(arrays['xyz'], **channels), None if labels is None else arrays['semantic'])

    def original_index(self, index: int) -> Int[np.ndarray, ' originals']:
        """For each line of the file, the row of :meth:`load_cloud` that stands for it; int32."""
        return np.concatenate(list(self.original_pieces(index)))

    def original_pieces(self, index: int) -> Iterator[Int[np.ndarray, ' _piece']]:
        """The same piece by piece: what is written for 10^8 points need not be held at once."""
        if self.cache is None:
            if self._rows is None or self._rows[0] != index:
                self.read_scene(index)
            assert self._rows is not None
            yield from self._rows[1]
            return
        key = self._key(index)
        pieces = int(self.cache.get_or_make(key, lambda: self._thin_into_cache(index))['pieces'])
        for number in range(pieces):
            try:
                arrays = read_npz(self.cache.path(f'{key}.{number:05d}'))
            except (FileNotFoundError, DamagedFileError):  # made again as a whole; the pieces are the same
                self._thin_into_cache(index)
                arrays = read_npz(self.cache.path(f'{key}.{number:05d}'))
            yield arrays['rows']

    def why_no_truth(self, index: int) -> str:
        """Test stations have none; others miss a file."""
        if self.split == 'test':
            return 'Semantic3D keeps the labels of its test stations to itself; use split="val"'
        return f'{self._files(index)[0].with_suffix(".labels").name}: no such file; expected the labels of the station'

    def _files(self, index: int) -> tuple[Path, Path | None]:
        station = self.scene_ids[index]
        points = self._find(station, '.txt')
        if points is None:
            raise self._not_found([station])
        beside = points.with_suffix('.labels')
        labels = beside if beside.is_file() else self._find(station, '.labels')
        return points, None if self.split == 'test' else labels

    def _key(self, index: int) -> str:
        points, labels = self._files(index)
        return file_key('semantic3d', (points,) if labels is None else (points, labels), {'voxel': self.edge})

    def _thin(self, index: int, keep_rows: Any) -> dict[str, np.ndarray]:
        points, labels = self._files(index)
        return dict(thin_scene(points, labels, self.edge, keep_rows)._asdict())

    def _thin_into_cache(self, index: int) -> dict[str, np.ndarray]:
        assert self.cache is not None
        key, cache, pieces = self._key(index), self.cache, 0

        def keep(rows: np.ndarray) -> None:
            nonlocal pieces
            write_npz(cache.path(f'{key}.{pieces:05d}'), {'rows': rows.astype(np.int32)})
            pieces += 1

        return self._thin(index, keep) | {'pieces': np.array(pieces)}

    def __getstate__(self) -> dict[str, Any]:
        """Without what was read last."""
        return super().__getstate__() | {'_rows': None}
