"""Scenes that tables of descriptors are measured on: synthetic ones made by need, real ones where they are present."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.datasets.oakland import OaklandDataset
from rm3d_plugin.datasets.s3dis import S3DISDataset
from rm3d_plugin.datasets.scannet import ScanNetDataset
from rm3d_plugin.datasets.segmentation import SegmentationDataset
from rm3d_plugin.datasets.semantic3d import HOLDOUT, Semantic3DDataset
from rm3d_plugin.datasets.semantickitti import SemanticKittiDataset
from rm3d_plugin.descriptors import cloud_normals
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments.spec import Request
from rm3d_plugin.regions.prepare import with_normals
from rm3d_plugin.structures import PointCloud

NORMAL_NEIGHBORS = 20
OUTDOOR_VOXEL = 0.15  # m, of the voxel downsampling outdoors
SEED = 1  # of synthetic scenes; the demos that learned descriptors are trained on have 0 or 101
NEAR = 20.0  # m; farther off the rings of a lidar are farther apart than any of the radii below
REAL_DATA = 'RM3D_REAL_DATA'  # environment variable; folder with oakland/ and semantickitti/


class TableScene(NamedTuple):
    """One scene with its truth.

    Attributes:
        name: Of the scene.
        cloud: With normals that turn with it, and curvature.
        semantic: Class of each point, -1 = ignored.
        objects: Object of each point: its instance, or its class where the class has none.
    """

    name: str
    cloud: PointCloud
    semantic: Int[np.ndarray, ' points']
    objects: Int[np.ndarray, ' points']


class Amount(NamedTuple):
    """How many scenes, and how many points of each (None: all)."""

    scenes: int
    points: int | None


@dataclass(frozen=True, eq=False)
class Collection:
    """Scenes of one kind.

    Attributes:
        name: Key of :data:`COLLECTIONS`.
        title: With synthetic or real, as tables print it.
        preset: Of descriptors and over-segmenters.
        classes: How many.
        tuning: Scenes whose annotated labels settings are tuned on.
        scenes: Scenes that are measured; none of them is in ``tuning``.
        options: Part -> arguments that win over its preset.
    """

    name: str
    title: str
    preset: Literal['indoor', 'lidar']
    classes: int
    tuning: tuple[TableScene, ...]
    scenes: tuple[TableScene, ...]
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


def turned(cloud: PointCloud, matrix: Float[np.ndarray, '3 3']) -> PointCloud:
    """The cloud and its sensor turned about the local origin; its normals and curvature are estimated anew."""
    bare = replace(cloud, xyz=cloud.xyz.astype(np.float64) @ matrix.T, normals=None, curvature=None)
    return described_surface(
        bare if cloud.sensor is None else replace(bare, sensor=matrix @ np.asarray(cloud.sensor, dtype=np.float64))
    )


def described_surface(cloud: PointCloud) -> PointCloud:
    """The cloud with normals and curvature; normals turn to the sensor, or to a viewpoint that moves with the cloud."""
    return with_normals(replace(cloud, normals=cloud_normals(cloud, NORMAL_NEIGHBORS)), NORMAL_NEIGHBORS)


def load_collections(request: Request) -> list[Collection]:
    """Read collections, making synthetic ones by need; real ones that are not there are named and left out.

    Args:
        request: Its ``data`` are keys of :data:`COLLECTIONS`; synthetic ones are made or found in its ``data_root``,
            by default in ``out/data``.

    Raises:
        ConfigError: There is no such collection.
    """
    unknown = [name for name in request.data if name not in COLLECTIONS]
    if unknown or request.scenes < 1 or (request.points is not None and request.points < 100):
        raise ConfigError(
            f'expected scenes >= 1, points >= 100 and data among {", ".join(COLLECTIONS)}; '
            f'got {request.scenes}, {request.points}, {unknown}'
        )
    found = []
    for name in request.data:
        collection = COLLECTIONS[name](
            request.data_root or request.out / 'data', Amount(request.scenes, request.points)
        )
        if collection is None:
            request.log(f'{name}: not in {real_root()} (environment variable {REAL_DATA}), left out')
        else:
            found.append(collection)
    return found


def real_root() -> Path:
    """Folder of real data; ``RM3D_REAL_DATA``, or ``shared/data`` beside the checkout."""
    return Path(os.environ.get(REAL_DATA, Path(__file__).resolve().parents[3] / 'shared' / 'data'))


def read_scenes(
    dataset: SegmentationDataset, indices: Sequence[int], points: int | None = None, near: float | None = None
) -> tuple[TableScene, ...]:
    """Scenes of a data set, cropped.

    Args:
        dataset: Labelled.
        indices: Which scenes.
        points: Keep the so many points nearest to the sensor or, where it is not known, to the median point.
        near: Keep the points so many metres around it.
    """
    return tuple(_read_scene(dataset, index, points, near) for index in indices)


def _read_scene(dataset: SegmentationDataset, index: int, points: int | None, near: float | None) -> TableScene:
    cloud, truth = dataset.load_cloud(index), dataset.load_truth(index)
    assert truth.semantic is not None
    instance = np.full(len(cloud), -1) if truth.instance is None else truth.instance
    objects = np.where(instance >= 0, instance, -2 - truth.semantic)
    middle = np.median(cloud.xyz, axis=0) if cloud.sensor is None else np.asarray(cloud.sensor)
    away = np.linalg.norm(cloud.xyz[:, :2] - middle[:2], axis=1)
    kept = np.argsort(away, kind='stable')[: len(cloud) if points is None else points]
    kept = np.sort(kept if near is None else kept[away[kept] < near])
    return TableScene(
        dataset.scene_ids[index], described_surface(cloud.select(kept)), truth.semantic[kept], objects[kept]
    )


def _rooms(data_root: Path, amount: Amount) -> Collection:
    from rm3d_plugin.datasets.synthetic import make_scannet_rooms  # virtual sensors take seconds to import

    root = make_scannet_rooms(
        data_root / f'rooms_{amount.scenes}_seed{SEED}', 1, amount.scenes, seed=SEED, progress=False
    )
    val = ScanNetDataset(root, 'val')
    tuning = read_scenes(ScanNetDataset(root, 'train'), [0], amount.points)
    found = read_scenes(val, range(amount.scenes), amount.points)
    return Collection('rooms', 'rooms (synthetic)', 'indoor', len(val.classes), tuning, found)


def _streets(data_root: Path, amount: Amount) -> Collection:
    from rm3d_plugin.datasets.synthetic import make_semantickitti_streets

    root = make_semantickitti_streets(
        data_root / f'streets_{amount.scenes}_seed{SEED}', 1, amount.scenes, seed=SEED, progress=False
    )
    val = SemanticKittiDataset(root, 'val', voxel_downsample=OUTDOOR_VOXEL)
    train = SemanticKittiDataset(root, 'train', sequences=(0,), voxel_downsample=OUTDOOR_VOXEL)
    return _lidar('streets', 'streets (synthetic)', read_scenes(train, [0], amount.points, NEAR), val, amount)


def _semantickitti(data_root: Path, amount: Amount) -> Collection | None:
    root = real_root() / 'semantickitti'
    there = sorted(
        int(folder.name) for folder in (root / 'sequences').glob('[0-9][0-9]') if (folder / 'labels').is_dir()
    )
    if len(there) < 2:
        return None
    teaching = SemanticKittiDataset(root, sequences=(there[1],), voxel_downsample=OUTDOOR_VOXEL)
    data = SemanticKittiDataset(root, sequences=tuple(there), voxel_downsample=OUTDOOR_VOXEL)
    tuning = read_scenes(teaching, [0], amount.points, NEAR)
    return _lidar('semantickitti', 'SemanticKITTI (real)', tuning, data, amount)


def _lidar(
    name: str, title: str, tuning: tuple[TableScene, ...], data: SegmentationDataset, amount: Amount
) -> Collection:
    options = {'RegionGrowing': {'ground': None}}  # the ground is a part of the partition that is scored
    taken = {scene.name for scene in tuning}
    left = [index for index, scene in enumerate(data.scene_ids) if scene not in taken]
    found = read_scenes(data, left[: amount.scenes], amount.points, NEAR)
    return Collection(name, title, 'lidar', len(data.classes), tuning, found, options)


def _oakland(data_root: Path, amount: Amount) -> Collection | None:
    root = real_root() / 'oakland'
    if not root.is_dir():
        return None
    test = OaklandDataset(root, 'test', voxel_downsample=OUTDOOR_VOXEL)
    tuning = read_scenes(OaklandDataset(root, 'train', voxel_downsample=OUTDOOR_VOXEL), [0], amount.points)
    wide = {'radius': 0.5, 'range_growth': 0.0}  # m; the sensor moved along the street
    options: dict[str, dict[str, Any]] = {
        'RegionGrowing': {'ground': None, 'max_edge': 0.6, 'range_growth': 0.0},
        'AdaptedPFH': wide,
        'FPFH': wide,
        'SHOT': wide,
        'VCCS': {'base': {'type': 'FPFH', **wide}},
    }
    found = read_scenes(test, range(min(amount.scenes, len(test))), amount.points)
    return Collection('oakland', 'Oakland (real)', 'lidar', len(test.classes), tuning, found, options)


def _offices(data_root: Path, amount: Amount) -> Collection:
    from rm3d_plugin.datasets.synthetic import make_s3dis_rooms

    root = make_s3dis_rooms(data_root / f'offices_{amount.scenes}_seed{SEED}', amount.scenes, seed=SEED, progress=False)
    test = S3DISDataset(root, 'test', cache=None)
    tuning = read_scenes(S3DISDataset(root, 'train', cache=None), [0], amount.points)
    found = read_scenes(test, range(amount.scenes), amount.points)
    return Collection('offices', 'offices, tripod (synthetic)', 'indoor', len(test.classes), tuning, found)


def _stations(data_root: Path, amount: Amount) -> Collection:
    from rm3d_plugin.datasets.synthetic import make_semantic3d_streets

    scenes = min(amount.scenes, len(HOLDOUT))
    root = make_semantic3d_streets(data_root / f'stations_{scenes}_seed{SEED}', 1, scenes, seed=SEED, progress=False)
    val = Semantic3DDataset(root, 'val', stations=HOLDOUT[:scenes], voxel_downsample=OUTDOOR_VOXEL)
    train = Semantic3DDataset(root, stations=('bildstein_station1',), voxel_downsample=OUTDOOR_VOXEL)
    tuning = read_scenes(train, [0], amount.points, NEAR)
    return _lidar('stations', 'streets, terrestrial scanner (synthetic)', tuning, val, amount)


COLLECTIONS: dict[str, Callable[[Path, Amount], Collection | None]] = {
    'rooms': _rooms,
    'streets': _streets,
    'offices': _offices,
    'stations': _stations,
    'semantickitti': _semantickitti,
    'oakland': _oakland,
}
