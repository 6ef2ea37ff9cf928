"""What every data set shares: how a scene becomes a training item, and where its labels may come from."""

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, get_args

import numpy as np
from jaxtyping import Float, Int
from torch.utils.data import Dataset

from rm3d_plugin.class_names import check_class_names
from rm3d_plugin.registry import TRANSFORMS
from rm3d_plugin.storage.label_store import LabelStore
from rm3d_plugin.storage.written_files import real_path
from rm3d_plugin.structures import UNLABELLED, Boxes3D, PointCloud, PseudoLabels, SceneError

Labels = Literal['none', 'store', 'truth']
Channel = Literal['intensity', 'rgb']
BadScenes = Literal['error', 'skip']


class DatasetNotFoundError(SceneError):
    """The data set is not where it was looked for; the message shows how to lay it out."""


def not_found(
    dataset: str, root: Path, what: str, source: str, layout: str, mark: str | None = None
) -> DatasetNotFoundError:
    """The error of a data set that is not there.

    Args:
        dataset: Its name.
        root: Where it was looked for.
        what: What is missing, such as 'there is no folder scans'.
        source: Where to get it, such as 'Download it from http://...'.
        layout: Folders and files, ``{root}`` for the root.
        mark: Pattern of a file or folder that the root must hold; where another folder near by holds one, it was meant.
    """
    root = real_path(root)
    near = '' if mark is None else _nearby(root, mark)
    return DatasetNotFoundError(
        f'{dataset} was looked for at {root}, but {what}.{near} {source} and lay it out so:\n'
        f'{layout.format(root=root)}\n'
        'then pass --cfg-options data_root=FOLDER. Without the data, --demo runs on synthetic scenes.'
    )


def _nearby(root: Path, mark: str) -> str:
    """Whether a folder above or below holds the data: archives bring folders of their own."""
    if not root.is_dir() or any(root.glob(mark)):
        return ''
    below = sorted(path for path in root.glob(f'*/{mark}') if not path.parent.name.startswith('.'))
    above = [path for folder in root.parents[:2] for path in folder.glob(mark)]
    found = [path.parents[len(Path(mark).parts) - 1] for path in [*above, *below]]
    return f' It seems to lie at {found[0]}: pass data_root={found[0]}.' if found else ''


def check_choice(name: str, value: object, choices: Sequence[object]) -> None:
    """Raise a ValueError that names the argument and its choices, unless the value is one of them."""
    if value not in choices:
        raise ValueError(f'{name}: expected one of {", ".join(map(str, choices))}, got {value!r}')


@dataclass(frozen=True, eq=False)
class Truth:
    """Dense ground truth of one scene: for label budgets, evaluation and reports, never for training with a budget.

    Attributes:
        boxes: Boxes of the data set's classes.
        semantic: (N,) int64 class of each point, -1 = ignored, or None. In detection the number of box classes stands
            for background.
        instance: (N,) int64 row of ``boxes`` or instance number, -1 = none, or None.
    """

    boxes: Boxes3D
    semantic: Int[np.ndarray, ' points'] | None = None
    instance: Int[np.ndarray, ' points'] | None = None


class SceneDataset(Dataset[dict[str, Any]], ABC):
    """Scenes that run through a pipeline of transforms.

    An item is a pure function of (seed, epoch, index): the sampler hands out ``epoch * len(dataset) + index``, and each
    item has its own generator ``default_rng([seed, epoch, index])`` in ``results['rng']``. So a resumed run sees the
    very items that an unbroken one sees, with any number of workers.

    Args:
        classes: Class names; their order gives the class numbers.
        pipeline: Transforms (registered configs or callables), each dict -> dict.
        labels: 'store': (pseudo) labels of the label store's current round; 'truth': ground truth, for metrics only;
            'none': no labels.
        label_store: Folder of the label store, needed for labels='store'.
        bad_scenes: 'error': a scene that cannot be used raises when it is read. 'skip': every scene is read once at
            the start (see :meth:`check_scene`), and those that cannot be used are left out, with one warning that
            counts and names them.
        seed: Of the items' generators.
        channels: What items have beside places, of intensity and rgb; None: all that a scan has.

    Attributes:
        alike: Whether all scans have the same channels.
    """

    alike: ClassVar[bool] = True

    def __init__(
        self,
        classes: Sequence[str],
        pipeline: Sequence[Mapping[str, Any] | Callable[[dict[str, Any]], dict[str, Any]]] = (),
        labels: Labels = 'none',
        label_store: str | Path | None = None,
        bad_scenes: BadScenes = 'error',
        seed: int = 0,
        channels: Sequence[Channel] | None = None,
    ) -> None:
        for channel in channels or ():
            check_choice('channels', channel, get_args(Channel))
        check_choice('labels', labels, get_args(Labels))
        check_choice('bad_scenes', bad_scenes, get_args(BadScenes))
        if labels == 'store' and label_store is None:
            raise ValueError("labels='store' needs label_store, the folder of the label store")
        self.classes = check_class_names(tuple(classes), 'classes')
        self.labels: Labels = labels
        self.label_store = None if label_store is None else LabelStore(label_store)
        self.bad_scenes: BadScenes = bad_scenes
        self.seed = seed
        self.channels = channels
        self.pipeline = [TRANSFORMS.build(step) if isinstance(step, Mapping) else step for step in pipeline]
        self._scene_ids: tuple[str, ...] | None = None

    # ------------------------------------------------------------------ what a data set implements

    @abstractmethod
    def find_scenes(self) -> tuple[str, ...]:
        """Names of all scenes, in a fixed order.

        Raises:
            DatasetNotFoundError: The data set is not there.
        """

    @abstractmethod
    def load_cloud(self, index: int) -> PointCloud:
        """The points of a scene, exactly the ones that labels are about.

        Raises:
            SceneError: The scene cannot be used.
        """

    @abstractmethod
    def load_truth(self, index: int) -> Truth:
        """Dense ground truth of a scene.

        Raises:
            SceneError: There is none, or it cannot be used.
        """

    def is_labelled(self, index: int) -> bool:
        """Whether a person labelled the scene at all; of others :meth:`load_truth` knows nothing."""
        return True

    def annotation(self, index: int) -> Any:
        """What the metric needs beyond boxes; handed on as metainfo ``annotation`` with labels='truth'."""
        return None

    def check_scene(self, index: int) -> None:
        """Read what a run needs of a scene: its points, and with labels='truth' its labels.

        Every data set of a run must leave out the same training scenes, so one whose labels are drawn from by a
        label budget checks them whatever ``labels`` is.

        Raises:
            SceneError: The scene cannot be used.
        """
        self.load_cloud(index)
        if self.labels == 'truth':
            self.load_truth(index)

    # ------------------------------------------------------------------ what mmengine calls

    @property
    def metainfo(self) -> dict[str, Any]:
        """What visualizers and metrics ask for."""
        return {'classes': self.classes, 'dataset_type': type(self).__name__}

    def full_init(self) -> None:
        """Find the scenes, and check them where bad ones shall be skipped; called once, by need."""
        if self._scene_ids is None:
            self._scene_ids = self.find_scenes()
            if self.bad_scenes == 'error':
                for scene_id in self._scene_ids:
                    _check_name(scene_id)
            if self.bad_scenes == 'skip':
                self._scene_ids = self._without_bad_scenes(self._scene_ids)

    @property
    def scene_ids(self) -> tuple[str, ...]:
        """Names of the scenes, in the order of the indices."""
        self.full_init()
        assert self._scene_ids is not None
        return self._scene_ids

    def __len__(self) -> int:
        return len(self.scene_ids)

    def __getitem__(self, item: int) -> dict[str, Any]:
        """One item; ``item = epoch * len(self) + index``, so a plain index is epoch 0."""
        if item < 0 or len(self) == 0:
            raise IndexError(f'item {item} of {len(self)} scenes')
        epoch, index = divmod(int(item), len(self))
        results = self.raw(index)
        results['rng'] = np.random.default_rng([self.seed, epoch, index])
        results['dataset'] = self
        for step in self.pipeline:
            results = step(results)
        results.pop('dataset', None)
        return results

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """The items of epoch 0 in order."""
        return (self[index] for index in range(len(self)))

    # ------------------------------------------------------------------ scene -> item

    def raw(self, index: int) -> dict[str, Any]:
        """A scene with the labels that ``labels`` allows, before the pipeline.

        Returns:
            scene_id, index, num_points, points (n, 3 + channels) float32 (x, y, z, then intensity and colour where the
            scan has them) and point_index (n,); with labels also semantic (n,), instance (n,), is_annotated (n,),
            confidence (n,), boxes (M, 7), box_labels (M,) and box_is_annotated (M,).

        Raises:
            SceneError: Scene or labels cannot be used, or they do not fit each other.
        """
        scene_id = self.scene_ids[index]
        try:
            cloud = self.load_cloud(index)
        except SceneError as error:
            raise type(error)(f'scene {scene_id}: {error}') from error
        results: dict[str, Any] = {
            'scene_id': scene_id,
            'index': index,
            'num_points': len(cloud),
            'points': self._features(cloud, scene_id),
            'point_index': np.arange(len(cloud)),
        }
        if self.labels == 'store':
            results |= self._stored_labels(scene_id, len(cloud))
        elif self.labels == 'truth':
            results |= _truth_labels(self.load_truth(index), len(cloud))
            results['annotation'] = self.annotation(index)
        return results

    def _features(self, cloud: PointCloud, scene_id: str) -> Float[np.ndarray, 'points channels']:
        there = [name for name, values in (('intensity', cloud.intensity), ('rgb', cloud.colors)) if values is not None]
        wanted = there if self.channels is None else self.channels
        if lacking := [name for name in wanted if name not in there]:
            raise SceneError(f'scene {scene_id}: has no {lacking[0]}; take it out of `channels`')
        return features(cloud, wanted)

    def _stored_labels(self, scene_id: str, num_points: int) -> dict[str, np.ndarray]:
        assert self.label_store is not None
        labels: PseudoLabels = self.label_store.read(scene_id)
        if len(labels) != num_points:
            raise SceneError(
                f'scene {scene_id}: {self.label_store.root} has labels for {len(labels)} points, the scene has '
                f'{num_points}. Cropping or data changed since the labels were made: delete the store and label again'
            )
        return {
            'semantic': labels.semantic,
            'instance': labels.instance,
            'is_annotated': labels.point_is_annotated,
            'confidence': labels.confidence,
            'boxes': labels.boxes.tensor,
            'box_labels': labels.boxes.labels,
            'box_is_annotated': labels.box_is_annotated,
        }

    def _without_bad_scenes(self, scene_ids: tuple[str, ...]) -> tuple[str, ...]:
        reasons: dict[str, str] = {}
        for index, scene_id in enumerate(scene_ids):
            try:
                _check_name(scene_id)
                self.check_scene(index)
            except SceneError as error:
                reasons[scene_id] = str(error)
            except Exception as error:  # a damaged file shows as anything from zlib.error to OSError
                reasons[scene_id] = f'{type(error).__name__}: {error}'
        if reasons and len(reasons) < len(scene_ids):
            first = '; '.join(f'{name}: {error}' for name, error in list(reasons.items())[:3])
            more = '; ...' if len(reasons) > 3 else ''
            warnings.warn(
                f'{len(reasons)} of {len(scene_ids)} scenes cannot be used and are left out: {first}{more}',
                stacklevel=2,
            )
        good = tuple(name for name in scene_ids if name not in reasons)
        if scene_ids and not good:
            self._scene_ids = None
            raise SceneError(f'none of {len(scene_ids)} scenes can be used; the first: {reasons[scene_ids[0]]}')
        return good


def _check_name(scene_id: str) -> None:
    """Whether a scene's name can be written into lists of labels, which are UTF-8.

    Raises:
        SceneError: It cannot.
    """
    try:
        scene_id.encode()
    except UnicodeEncodeError:
        raise SceneError(f'scene {scene_id!r}: the name of its file or folder is no UTF-8; rename it') from None


def features(cloud: PointCloud, channels: Sequence[str] = get_args(Channel)) -> Float[np.ndarray, 'points channels']:
    """Coordinates, then intensity and colour where the scan has them and they are wanted; float32."""
    columns = [cloud.xyz]
    if cloud.intensity is not None and 'intensity' in channels:
        columns.append(cloud.intensity[:, None])
    if cloud.colors is not None and 'rgb' in channels:
        columns.append(cloud.colors)
    return np.concatenate(columns, axis=1)


def _truth_labels(truth: Truth, num_points: int) -> dict[str, np.ndarray]:
    nothing = np.full(num_points, UNLABELLED, dtype=np.int64)
    semantic = nothing if truth.semantic is None else truth.semantic
    return {
        'semantic': semantic,
        'instance': nothing if truth.instance is None else truth.instance,
        'is_annotated': semantic != UNLABELLED,
        'confidence': (semantic != UNLABELLED).astype(np.float32),
        'boxes': truth.boxes.tensor,
        'box_labels': truth.boxes.labels,
        'box_is_annotated': np.ones(len(truth.boxes), dtype=bool),
    }
