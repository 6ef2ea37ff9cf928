"""What is predicted of a scan, in the format that somebody asked for."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.datasets import scannet_format, semantic3d_format, semantickitti_format
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.models.heads.proposals import Instances
from rm3d_plugin.ops.segment import first_mask
from rm3d_plugin.storage import write_npz
from rm3d_plugin.storage.columns import RGB
from rm3d_plugin.storage.exports import (
    las_classes,
    need_laspy,
    write_instance_text,
    write_label_words,
    write_las,
    write_numbers,
)
from rm3d_plugin.storage.kept_columns import kept_names
from rm3d_plugin.storage.labelled import write_labelled
from rm3d_plugin.storage.text_columns import plain_name
from rm3d_plugin.structures import PointCloud
from rm3d_plugin.visualization.palette import region_colors

BENCHMARKS: dict[str, dict[str, int]] = {
    'scannet': dict(zip(scannet_format.CLASSES, scannet_format.NYU40_IDS, strict=True)),
    'semantickitti': dict(zip(semantickitti_format.CLASSES, semantickitti_format.CLASS_TO_RAW.tolist(), strict=True)),
    'semantic3d': {name: number + 1 for number, name in enumerate(semantic3d_format.CLASSES)},
}
"""Class name -> id in a submission; 0 = nothing said."""


@dataclass(frozen=True, eq=False)
class ScanPrediction:
    """What is predicted of a scan, on all points of its file.

    Attributes:
        semantic: (N,) int64 class, -1 = unknown.
        confidence: (N,) float32 probability of the most likely class, also where that is not said; 0 where the network
            did not see the point.
        instances: Instances, best first; None from a network without an instance head.
    """

    semantic: Int[np.ndarray, ' points']
    confidence: Float[np.ndarray, ' points']
    instances: Instances | None = None

    @property
    def instance(self) -> Int[np.ndarray, ' points']:
        """Best instance of each point, -1 = none, or the class of the point is unknown."""
        if self.instances is None:
            return np.full(len(self.semantic), -1, dtype=np.int64)
        return np.where(self.semantic < 0, -1, first_mask(self.instances.masks))


@dataclass(frozen=True, eq=False)
class ScanFile:
    """A scan as it was read, for formats that keep what it holds.

    Attributes:
        path: The file.
        columns: (N,) numbers by name, of the points that were read.
        cloud: The same points.
        whole: Whether these are all points of the file.
        paint: Colours show the classes, and those of the scan are kept as ``input_red`` ...; False: only where the scan
            has none.
        classify: ``classification`` of LAS holds the classes, and that of the scan is kept as ``input_classification``.
    """

    path: Path
    columns: Mapping[str, np.ndarray]
    cloud: PointCloud
    whole: bool = True
    paint: bool = False
    classify: bool = False


def world_xyz(cloud: PointCloud) -> Float[np.ndarray, 'points 3']:
    """Coordinates as in the file: float64 where they are far from zero, else float32."""
    return cloud.xyz.astype(np.float64) + np.asarray(cloud.origin) if np.any(cloud.origin) else cloud.xyz


def class_colors(semantic: Int[np.ndarray, ' points']) -> Float[np.ndarray, 'points 3']:
    """A colour for each class, grey for unknown."""
    return region_colors(semantic)


def _point_columns(found: ScanPrediction) -> dict[str, np.ndarray]:
    columns = {'confidence': found.confidence.astype(np.float32)}
    if found.instances is not None:
        columns['instance'] = found.instance.astype(np.int32)
    return columns


def _with_places(scan: ScanFile) -> dict[str, np.ndarray]:
    """The columns of a file, x, y and z first and under these names."""
    if {*'xyz'} <= scan.columns.keys():
        return dict(scan.columns)
    others = {name: values for name, values in scan.columns.items() if plain_name(name) not in ('x', 'y', 'z')}
    return dict(zip('xyz', world_xyz(scan.cloud).T, strict=True)) | others


def _bytes_of(colors: Float[np.ndarray, 'points 3']) -> dict[str, np.ndarray]:
    return dict(zip(RGB, np.round(colors * 255).astype(np.uint8).T, strict=True))


def _has_colors(scan: ScanFile) -> bool:
    """Under any names: ``R;G;B``, say; or colours that nobody measured, which were read as none."""
    return scan.cloud.colors is not None or {*RGB} <= {plain_name(name) for name in scan.columns}


def _ply(out: Path, name: str, scan: ScanFile, found: ScanPrediction, classes: Sequence[str]) -> list[Path]:
    added = {'label': found.semantic.astype(np.int32)} | _point_columns(found)
    if scan.paint or not _has_colors(scan):
        added |= _bytes_of(class_colors(found.semantic))
    return [write_labelled(scan.path, out / f'{name}.ply', _with_places(scan), added)]


def _las(out: Path, name: str, scan: ScanFile, found: ScanPrediction, classes: Sequence[str]) -> list[Path]:
    target = out / f'{name}.las'
    if scan.path.suffix.lower() in ('.las', '.laz') and scan.whole:
        added = {'label': found.semantic.astype(np.int32)} | _point_columns(found)
        if scan.classify:
            added['classification'] = las_classes(found.semantic)
        return [write_labelled(scan.path, target, scan.columns, added)]
    cloud = scan.cloud
    xyz = cloud.xyz.astype(np.float64) + np.asarray(cloud.origin)
    colors = class_colors(found.semantic) if scan.paint or cloud.colors is None else cloud.colors
    return [write_las(target, xyz, colors, found.semantic, _point_columns(found), classes, scan.columns)]


def _npz(out: Path, name: str, scan: ScanFile, found: ScanPrediction, classes: Sequence[str]) -> list[Path]:
    added = {'label': found.semantic.astype(np.int32)} | _point_columns(found)
    added |= {'classes': np.array(list(classes) or [''])}
    if found.instances is not None:
        added |= {'instance_labels': found.instances.labels, 'instance_scores': found.instances.scores}
    if scan.path.suffix.lower() == '.npz' and scan.whole:
        return [write_labelled(scan.path, out / f'{name}.npz', scan.columns, added)]
    added |= {'xyz': scan.cloud.xyz, 'origin': np.asarray(scan.cloud.origin)}
    kept = {column: values for column, values in scan.columns.items() if column not in tuple('xyz')}
    names = kept_names(kept, added)
    return [write_npz(out / f'{name}.npz', added | {names[column]: values for column, values in kept.items()})]


def benchmark_ids(
    benchmark: str, semantic: Int[np.ndarray, ' points'], classes: Sequence[str]
) -> Int[np.ndarray, ' points']:
    """Ids of a benchmark, by the names of the classes; 0 where the class is unknown.

    Raises:
        ConfigError: A class has no id there.
    """
    ids = BENCHMARKS[benchmark]
    strange = [name for name in classes if name not in ids]
    if strange:
        raise ConfigError(
            f'--format {benchmark}: the network knows the class {strange[0]!r}, which is not one of {", ".join(ids)}; '
            'use ply, las or npz'
        )
    table = np.array([*(ids[name] for name in classes), 0])  # -1, the last, is unknown
    return table[semantic]


def _scannet(out: Path, name: str, scan: ScanFile, found: ScanPrediction, classes: Sequence[str]) -> list[Path]:
    scene = name.removesuffix('_vh_clean_2')
    files = [write_numbers(out / 'semantic' / f'{scene}.txt', benchmark_ids('scannet', found.semantic, classes))]
    if found.instances is not None:
        kinds = benchmark_ids('scannet', found.instances.labels, classes)
        path = out / 'instance' / f'{scene}.txt'
        files += write_instance_text(path, found.instances.masks, kinds, found.instances.scores)[:1]
    return files


def _semantickitti(out: Path, name: str, scan: ScanFile, found: ScanPrediction, classes: Sequence[str]) -> list[Path]:
    ids = benchmark_ids('semantickitti', found.semantic, classes)
    return [write_label_words(out / f'{name}.label', ids, found.instance + 1)]


def _semantic3d(out: Path, name: str, scan: ScanFile, found: ScanPrediction, classes: Sequence[str]) -> list[Path]:
    return [write_numbers(out / f'{name}.labels', benchmark_ids('semantic3d', found.semantic, classes))]


Writer = Callable[[Path, str, ScanFile, ScanPrediction, Sequence[str]], list[Path]]
FORMATS: dict[str, Writer] = {
    'ply': _ply,
    'las': _las,
    'npz': _npz,
    'scannet': _scannet,
    'semantickitti': _semantickitti,
    'semantic3d': _semantic3d,
}


def check_format(name: str, classes: Sequence[str]) -> None:
    """Whether predictions can be written so, before any are made.

    Raises:
        ConfigError: No such format, or the classes are not those of the benchmark.
        SceneError: A package is not installed.
    """
    if name not in FORMATS:
        raise ConfigError(f'--format: expected one of {", ".join(FORMATS)}, got {name!r}')
    if name in BENCHMARKS:
        benchmark_ids(name, np.zeros(0, dtype=np.int64), classes)
    if name == 'las':
        need_laspy('--format las')


def write_prediction(
    kind: str, out: Path, name: str, scan: ScanFile, found: ScanPrediction, classes: Sequence[str]
) -> list[Path]:
    """Write what is predicted of a scan.

    Args:
        kind: One of :data:`FORMATS`.
        out: Folder.
        name: Of the scan, without an ending.
        scan: The scan, all points.
        found: On all its points.
        classes: Class names.

    Returns:
        The files, without those of single instance masks.
    """
    return FORMATS[kind](out, name, scan, found, classes)


def main_file(scan: Path, kind: str) -> str:
    """Name of the main file that is written for a scan, within the output folder."""
    ending = {'semantickitti': '.label', 'semantic3d': '.labels', 'scannet': '.txt'}.get(kind, f'.{kind}')
    if kind == 'scannet':
        return f'semantic/{scan.stem.removesuffix("_vh_clean_2")}{ending}'
    return f'{output_name(scan, kind)}{ending}'


def output_name(scan: Path, kind: str) -> str:
    """Name of a scan's output within the output folder, without an ending.

    A scan of SemanticKITTI goes where its benchmark expects it: ``sequences/11/predictions/000000``.
    """
    if kind == 'semantickitti' and scan.parent.name == 'velodyne' and scan.parent.parent.parent.name == 'sequences':
        return f'sequences/{scan.parent.parent.name}/predictions/{scan.stem}'
    return scan.stem
