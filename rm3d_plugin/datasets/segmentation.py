"""What data sets with a class for each point share: thinning, truth by the kept points, the way back to all points."""

import hashlib
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from rm3d_plugin.class_names import class_index
from rm3d_plugin.datasets.base import SceneDataset, Truth
from rm3d_plugin.datasets.downsampled import KeptPoints, check_voxel, keep_points
from rm3d_plugin.storage.files import content_key
from rm3d_plugin.storage.scene_cache import SceneCache
from rm3d_plugin.structures import UNLABELLED, Boxes3D, PointCloud, SceneError

FAR = 1e3  # m; beyond, float32 is coarser than 0.1 mm and coordinates move to a local frame
CACHE_VERSION = 2  # raise it when a reader changes what it makes of the same files


class RawScene(NamedTuple):
    """A scene as its files have it, every point.

    Attributes:
        cloud: The points.
        semantic: (N,) int64 class of each point, -1 = ignored; None where the files hold no labels.
        instance: (N,) int64 instance numbers from 0, -1 = none; None where the files hold none.
    """

    cloud: PointCloud
    semantic: Int[np.ndarray, ' points'] | None = None
    instance: Int[np.ndarray, ' points'] | None = None


class WholeTruth(NamedTuple):
    """Truth of every original point of a scene, as metrics read it; see ``evaluation.point_fields.point_truth``.

    Attributes:
        semantic: (N,) int64 classes.
        instance: (N,) int64 instance numbers, or None.
        original_index: (N,) int64 row of the thinned scene that stands for each point; None: nothing was thinned.
    """

    semantic: Int[np.ndarray, ' points']
    instance: Int[np.ndarray, ' points'] | None
    original_index: Int[np.ndarray, ' points'] | None


class SegmentationDataset(SceneDataset):
    """Scenes whose points have classes, and instance numbers where the data set has things.

    Args:
        split: 'train' and 'trainval' refuse labels='truth'.
        voxel_downsample: Keep one point in each cube of this edge, metres; None: every point. Predictions go back to
            all points through :meth:`original_index`.
        cache: Folder where what is slow to read (text) is kept after the first time; None: nowhere.
        base: Arguments of :class:`SceneDataset`.

    Raises:
        ValueError: A choice that there is not.
    """

    def __init__(
        self, split: str, voxel_downsample: float | None = None, cache: str | Path | None = None, **base: Any
    ) -> None:
        super().__init__(**base)
        if self.labels == 'truth' and split in ('train', 'trainval'):
            raise ValueError(
                f"labels='truth' is for splits that metrics are measured on, got split {split!r}; "
                "training reads labels='store', prediction needs labels='none'"
            )
        self.split = split
        self.voxel_downsample = None if voxel_downsample is None else check_voxel(voxel_downsample)
        self.cache = None if cache is None else SceneCache(cache)
        self._last: tuple[int, RawScene, KeptPoints] | None = None

    @abstractmethod
    def read_scene(self, index: int) -> RawScene:
        """Every point of a scene, with its labels where the files hold them.

        Raises:
            SceneError: The scene cannot be used.
        """

    def original_index(self, index: int) -> Int[np.ndarray, ' points']:
        """Row of :meth:`load_cloud` that stands for each original point; identity when nothing is thinned."""
        return self._scene(index)[1].rows

    @property
    def metainfo(self) -> dict[str, Any]:
        """What visualizers and metrics ask for; instance metrics count ``thing_classes`` only."""
        return super().metainfo | {'thing_classes': self.thing_classes}

    @property
    def thing_classes(self) -> tuple[int, ...]:
        """Numbers of the classes that have instances; () where the data set has none."""
        return ()

    def load_cloud(self, index: int) -> PointCloud:
        """The points of a scene, thinned where asked for; in the order of the files."""
        scene, thin = self._scene(index)
        return scene.cloud if len(thin.kept) == len(scene.cloud) else scene.cloud.select(thin.kept)

    def load_truth(self, index: int) -> Truth:
        """Class and instance number of each point of :meth:`load_cloud`.

        Raises:
            SceneError: The files hold no labels, or they cannot be used.
        """
        scene, thin = self._scene(index)
        if scene.semantic is None:
            raise SceneError(f'scene {self.scene_ids[index]}: {self.why_no_truth(index)}')
        instance = None if scene.instance is None else _renumber(scene.instance[thin.kept])
        return Truth(Boxes3D.empty(), scene.semantic[thin.kept], instance)

    def annotation(self, index: int) -> WholeTruth | None:
        """Truth of all points, so that metrics count those that were thinned away or dropped; None without labels."""
        scene, thin = self._scene(index)
        if scene.semantic is None:
            return None
        instance = None if scene.instance is None else _renumber(scene.instance)
        complete = self.voxel_downsample is None and not thin.stray.any()
        return WholeTruth(scene.semantic, instance, None if complete else thin.rows)

    def why_no_truth(self, index: int) -> str:
        """What to tell who asks for labels that the files do not hold."""
        return f'split {self.split!r} has no labels; expected a labelled split'

    def parsed(
        self,
        reader: str,
        paths: tuple[Path, ...],
        parse: Callable[[], dict[str, np.ndarray]],
        options: Mapping[str, Any] | None = None,
    ) -> dict[str, np.ndarray]:
        """What ``parse`` makes of files that are slow to read; from the cache, where there is one."""
        return parse() if self.cache is None else self.cache.get_or_make(file_key(reader, paths, options), parse)

    def check_scene(self, index: int) -> None:
        """Read everything there is of a scene, labels too.

        Raises:
            SceneError: The scene cannot be used, or labels='truth' finds none.
        """
        self._scene(index)
        if self.labels == 'truth':
            self.load_truth(index)

    def _scene(self, index: int) -> tuple[RawScene, KeptPoints]:
        """The scene, kept until another one is asked for: points, truth and the way back are asked for in a row."""
        if self._last is None or self._last[0] != index:
            scene = self.read_scene(index)
            if len(scene.cloud) == 0:
                raise SceneError(f'scene {self.scene_ids[index]}: holds no points; leave it out')
            for name, values in (('semantic', scene.semantic), ('instance', scene.instance)):
                if values is not None and len(values) != len(scene.cloud):
                    raise SceneError(
                        f'scene {self.scene_ids[index]}: {name}: {len(values)} labels for {len(scene.cloud)} points'
                    )
            xyz = scene.cloud.xyz.astype(np.float64) + scene.cloud.origin
            try:
                thin = keep_points(xyz, self.voxel_downsample, f'scene {self.scene_ids[index]}')
            except ValueError as error:
                raise SceneError(f'scene {self.scene_ids[index]}: {error}') from error
            self._last = index, _without_labels(scene, thin.stray), thin
        return self._last[1], self._last[2]

    def __getstate__(self) -> dict[str, Any]:
        """Without the scene that was read last: it would travel to every data loader process."""
        return self.__dict__ | {'_last': None}


def check_classes(dataset: str, classes: tuple[str, ...], count: int) -> None:
    """Raise a ValueError unless there is a name for each class of a data set."""
    if len(classes) != count:
        raise ValueError(f'classes: expected names for the {count} classes of {dataset}, got {classes}')


def numbers_of_things(things: Sequence[str], classes: tuple[str, ...]) -> tuple[int, ...]:
    """Class numbers of the named classes, ascending.

    Raises:
        ValueError: A name is no class.
    """
    numbers = {name: class_index(name, classes) for name in things}
    if unknown := sorted(name for name, number in numbers.items() if number is None):
        raise ValueError(f'things: {unknown[0]!r} is no class; expected some of {", ".join(classes)}')
    return tuple(sorted({number for number in numbers.values() if number is not None}))


def only_things(
    instance: Int[np.ndarray, ' points'], semantic: Int[np.ndarray, ' points'], things: tuple[int, ...]
) -> Int[np.ndarray, ' points']:
    """Instance numbers of points whose class has instances; -1 elsewhere.

    An instance is a pair of number and class, since files count either through the scene or within each class. The
    pairs are numbered 0, 1, ... in their order.
    """
    wanted = np.isin(semantic, things) & (instance >= 0)
    number = np.unique(instance, return_inverse=True)[1].reshape(-1)
    pair = number * (max(things, default=0) + 1) + semantic
    return _renumber(np.where(wanted, pair, UNLABELLED))


def _without_labels(scene: RawScene, stray: Bool[np.ndarray, ' points']) -> RawScene:
    """The scene, nothing said of stray points."""
    if not stray.any():
        return scene
    semantic, instance = (
        None if labels is None else np.where(stray, UNLABELLED, labels) for labels in (scene.semantic, scene.instance)
    )
    return RawScene(scene.cloud, semantic, instance)


def _renumber(instance: Int[np.ndarray, ' points']) -> Int[np.ndarray, ' points']:
    """The same instances numbered 0, 1, ... without gaps, in ascending order; -1 stays."""
    found, inverse = np.unique(instance, return_inverse=True)
    first = int(np.searchsorted(found, 0))
    numbers = np.r_[np.full(first, UNLABELLED), np.arange(len(found) - first)]
    return numbers[inverse.reshape(-1)].astype(np.int64)


def make_cloud(xyz: np.ndarray, **channels: np.ndarray) -> PointCloud:
    """A cloud from float64 coordinates; far ones move to a local frame, and ``origin`` tells where it lies."""
    if len(xyz) and np.abs(xyz).max() > FAR:
        return PointCloud.from_world(xyz, **channels)
    return PointCloud(np.asarray(xyz, dtype=np.float32), **channels)


def file_key(reader: str, paths: tuple[Path, ...], options: Mapping[str, Any] | None = None) -> str:
    """A cache key of files: the hash of their content, so that a file changed within a tick of the clock is noticed."""
    digests = []
    for path in paths:
        with path.open('rb') as file:
            digests.append(hashlib.file_digest(file, 'sha256').hexdigest())
    return content_key(reader, CACHE_VERSION, digests, dict(options or {}))
