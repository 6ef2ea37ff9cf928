"""Where making labels meets learning from them: scenes in, the label store filled."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from joblib import Parallel, delayed
from mmengine.dist import is_main_process
from tqdm import tqdm

from rm3d_plugin.engine.label_report import describe_round, summarise
from rm3d_plugin.engine.sources import LabelSource
from rm3d_plugin.ops.ground import segment_ground
from rm3d_plugin.pseudo_labels import ObjectRules, WeakLabels, refresh_detection
from rm3d_plugin.pseudo_labels.boxes import size_priors
from rm3d_plugin.pseudo_labels.quality import SceneTruth
from rm3d_plugin.regions import MergeStrategy
from rm3d_plugin.regions.prepare import PreparedScene, prepare_scene
from rm3d_plugin.registry import DESCRIPTORS, OVERSEGMENTERS, TASK_UTILS
from rm3d_plugin.storage import LabelStore, SceneCache, content_key

Log = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class PointPrediction:
    """What the network says of every point of a scene; rows it did not see are NaN.

    Attributes:
        probabilities: (N, C) softmax; in detection the last class is background.
        centers: (N, 3) metres, the voted object centre, or None.
    """

    probabilities: Float[np.ndarray, 'points classes']
    centers: Float[np.ndarray, 'points 3'] | None


@TASK_UTILS.register_module()
class SceneLabeler:
    """Prepares the geometry of the training scenes and writes their labels, round by round.

    Args:
        store: Folder of the label store.
        cache: Folder of prepared geometry; shared by runs, keyed by content and parameters.
        source: A :class:`~rm3d_plugin.engine.sources.LabelSource` or its config.
        descriptor: Config of a descriptor provider.
        oversegmenter: Config of an over-segmenter.
        strategy: Fields of :class:`~rm3d_plugin.regions.MergeStrategy`.
        graph_neighbors: K, adjacent regions that each region keeps.
        max_gap: Metres; regions farther apart are not adjacent.
        default_sizes: (C, 3) metres, for classes without a revealed box.
        rules: Fields of :class:`~rm3d_plugin.pseudo_labels.ObjectRules`.
    """

    def __init__(
        self,
        store: str | Path,
        cache: str | Path,
        source: Mapping[str, Any] | LabelSource,
        descriptor: Mapping[str, Any],
        oversegmenter: Mapping[str, Any],
        strategy: Mapping[str, Any] | None = None,
        graph_neighbors: int = 8,
        max_gap: float | None = None,
        default_sizes: Sequence[Sequence[float]] | None = None,
        rules: Mapping[str, Any] | None = None,
    ) -> None:
        self.store = LabelStore(store)
        self.cache = SceneCache(cache)
        self.source: LabelSource = TASK_UTILS.build(source) if isinstance(source, Mapping) else source
        self.strategy = MergeStrategy(**(strategy or {}))
        self._settings = (dict(descriptor), dict(oversegmenter), graph_neighbors, max_gap)
        self._descriptor = DESCRIPTORS.build(dict(descriptor))
        self._oversegmenter = OVERSEGMENTERS.build(dict(oversegmenter))
        self._graph_neighbors, self._max_gap = graph_neighbors, max_gap
        self._default_sizes = None if default_sizes is None else np.asarray(default_sizes, dtype=np.float64)
        self._index = {scene: i for i, scene in enumerate(self.source.scene_ids)}
        self._weak: dict[str, WeakLabels] = {}
        self._rules = ObjectRules(**(rules or {}))

    # ------------------------------------------------------------------ geometry and weak labels

    def prepared(self, scene_id: str) -> PreparedScene:
        """Regions and graph of a scene, from the cache or made now."""
        cloud = self.source.load_cloud(self._index[scene_id])
        channels = [values for values in (cloud.xyz, cloud.intensity, cloud.colors) if values is not None]
        key = content_key('prepared', PREPARED_VERSION, channels, self._settings)

        def make() -> dict[str, np.ndarray]:
            scene = prepare_scene(cloud, self._descriptor, self._oversegmenter, self._graph_neighbors, self._max_gap)
            return scene.to_arrays()

        return PreparedScene.from_arrays(self.cache.get_or_make(key, make))

    def weak(self, scene_id: str) -> WeakLabels:
        """Revealed labels of a scene."""
        if scene_id not in self._weak:
            self._weak[scene_id] = self.source.weak_labels(self._index[scene_id])
        return self._weak[scene_id]

    @cached_property
    def priors(self) -> Float[np.ndarray, 'classes 3']:
        """Median sizes of the revealed boxes by class, metres; ``default_sizes`` (or NaN) for a class without any."""
        known = [self.weak(scene).boxes for scene in self._index]
        boxes = np.concatenate([b.tensor for b in known]) if known else np.zeros((0, 7))
        labels = np.concatenate([b.labels for b in known]) if known else np.zeros(0, dtype=np.int64)
        sizes = size_priors(boxes, labels, len(self.source.classes))
        if self._default_sizes is not None:
            sizes = np.where(np.isfinite(sizes), sizes, self._default_sizes)
        return sizes

    @cached_property
    def class_counts(self) -> Int[np.ndarray, ' classes']:
        """Revealed boxes of each class."""
        labels = np.concatenate([self.weak(scene).boxes.labels for scene in self._index])
        return np.bincount(labels, minlength=len(self.source.classes))

    def prepare(self, jobs: int = 1) -> None:
        """Fill the geometry cache.

        Args:
            jobs: Processes; any joblib backend that is set (dask, say) is used.
        """
        if jobs == 1:
            for scene in tqdm(self._index, desc='preparing geometry'):
                self.prepared(scene)
            return
        tasks = (delayed(_prepare_one)(self, scene) for scene in self._index)
        done = Parallel(n_jobs=jobs, return_as='generator_unordered')(tasks)
        for _ in tqdm(done, total=len(self._index), desc=f'preparing geometry, {jobs} processes'):
            pass

    # ------------------------------------------------------------------ what the hook calls

    def start(self, keep: bool, log: Log = print) -> None:
        """Open the budget, prepare every scene, and write the labels of round 0.

        Args:
            keep: Go on with the budget and the rounds of an interrupted run.
            log: Told what is revealed and what round 0 labels.
        """
        self.source.open(self.store.root, resume=keep)
        log(self.source.describe())
        self.prepare()
        if not (keep and self.is_finished(0)):
            self.begin(0)
            for scene in tqdm(self._index, desc='labels, round 0'):
                self.refresh(0, scene, None)
            self.finish(0, log)

    def inform(self, model: Any) -> None:
        """Tell the model the sizes of the revealed boxes, where it asks for them."""
        if hasattr(model, 'set_mean_sizes') and np.isfinite(self.priors).all():
            model.set_mean_sizes(torch.tensor(self.priors, dtype=torch.float32))

    def is_finished(self, number: int) -> bool:
        """Whether the labels of a round are complete on disk."""
        return self.store.is_complete(number)

    def use(self, number: int) -> None:
        """From now on training reads the labels of this round."""
        if is_main_process():
            self.store.set_current(number)

    def begin(self, number: int) -> None:
        """Clear what an interrupted refresh of this round left."""
        self.store.begin_round(number, overwrite=True)

    def refresh(self, number: int, scene_id: str, prediction: PointPrediction | None) -> None:
        """Write the labels of one scene for one round.

        Args:
            number: The round; 0 is made without a prediction.
            scene_id: Which scene.
            prediction: What the network says of its points.
        """
        scene = self.prepared(scene_id)
        result = refresh_detection(
            scene.cloud,
            scene.regions,
            scene.graph,
            self.weak(scene_id),
            None if prediction is None else prediction.probabilities,
            None if prediction is None else prediction.centers,
            self.store.read(scene_id, number - 1) if number else None,
            self.strategy,
            number,
            self.priors,
            self.class_counts,
            segment_ground(scene.cloud.xyz).height,
            self._rules,
        )
        self.store.write(number, scene_id, result.labels, result.merge.ledger.to_arrays())

    def finish(self, number: int, log: Log = print) -> None:
        """Close a round and say how good its labels are, as far as the truth is known (a report, never training)."""
        scenes = [(self.store.read(scene, number), self._truth(index)) for scene, index in self._index.items()]
        summary = summarise(scenes, self.source.classes)
        self.store.finish_round(number, summary)
        log(f'labels of round {number}: {describe_round(summary)}')

    def _truth(self, index: int) -> SceneTruth | None:
        truth = self.source.truth(index)
        if truth is None or truth.semantic is None:
            return None
        cloud = self.source.load_cloud(index)
        ranges = None if cloud.sensor is None else np.linalg.norm(cloud.xyz - cloud.sensor, axis=1)
        return SceneTruth(truth.semantic, truth.boxes, ranges)


def _prepare_one(labeler: SceneLabeler, scene_id: str) -> None:
    labeler.prepared(scene_id)


PREPARED_VERSION = 1  # raise it when the geometry path changes, so that older caches are not read
