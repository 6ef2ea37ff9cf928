"""What label makers have in common: geometry in a cache, labels of each round in the label store."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from joblib import Parallel, delayed
from mmengine.dist import is_main_process
from tqdm import tqdm

from rm3d_plugin.labeling.round_summary import describe_round
from rm3d_plugin.labeling.round_times import Seconds, Stopwatch
from rm3d_plugin.labeling.sources import LabelSource
from rm3d_plugin.pseudo_labels import AnnotatedLabels
from rm3d_plugin.regions import MergeStrategy
from rm3d_plugin.regions.geometry import SceneGeometry
from rm3d_plugin.regions.prepare import PreparedScene
from rm3d_plugin.registry import TASK_UTILS
from rm3d_plugin.storage import LabelStore, SceneCache
from rm3d_plugin.storage.recent import RecentItems
from rm3d_plugin.structures import Boxes3D, PointCloud, PseudoLabels

Log = Callable[[str], None]
SCENES_IN_MEMORY = 512  # MB of prepared scenes: data sets of some dozen scans are read once


@dataclass(frozen=True, eq=False)
class PointPrediction:
    """What the network says of every point of a scene; rows it did not see are NaN.

    Attributes:
        probabilities: (N, C) softmax; in detection the last class is background.
        centers: (N, 3) metres, the voted object centre, or None.
        boxes: Predicted boxes with scores, or None.
    """

    probabilities: Float[np.ndarray, 'points classes']
    centers: Float[np.ndarray, 'points 3'] | None
    boxes: Boxes3D | None = None


class SceneLabels(NamedTuple):
    """Labels of one scene, with the arrays of the ledger that tells how they came about (None: nothing merged)."""

    labels: PseudoLabels
    ledger: dict[str, np.ndarray] | None


class LabelMaker(ABC):
    """Prepares the geometry of the training scenes and writes their labels, round by round.

    A subclass says what the labels of a scene are (:meth:`make_labels`), how good those of a round are
    (:meth:`summarise_round`), and from which points the over-segmentation starts (:meth:`seeds`).

    Args:
        store: Folder of the label store.
        cache: Folder of prepared geometry; shared by runs, keyed by content and parameters.
        source: A :class:`~rm3d_plugin.labeling.sources.LabelSource` or its config.
        descriptor: Config of a descriptor provider.
        oversegmenter: Config of an over-segmenter.
        strategy: Fields of :class:`~rm3d_plugin.regions.MergeStrategy`.
        graph_neighbors: K, adjacent regions that each region keeps.
        max_gap: Metres; regions farther apart are not adjacent.

    Attributes:
        judging: What comparing the labels of the last round with the truth took, where the truth is known.
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
    ) -> None:
        self.store = LabelStore(store)
        self.cache = SceneCache(cache)
        self.source: LabelSource = TASK_UTILS.build(source) if isinstance(source, Mapping) else source
        self.strategy = MergeStrategy(**(strategy or {}))
        self._geometry = SceneGeometry(self.cache, descriptor, oversegmenter, graph_neighbors, max_gap)
        self.index_of = {scene: i for i, scene in enumerate(self.source.scene_ids)}
        self.judging = Seconds()
        self._keys: dict[str, str] = {}
        self._recent: RecentItems[PreparedScene] = RecentItems(SCENES_IN_MEMORY, PreparedScene.nbytes)

    # ------------------------------------------------------------------ what a subclass says

    @abstractmethod
    def make_labels(self, number: int, scene_id: str, prediction: PointPrediction | None) -> SceneLabels:
        """Labels of one scene for one round; ``prediction`` is None in round 0."""

    @abstractmethod
    def summarise_round(self, number: int) -> dict[str, Any]:
        """How good the labels of a round are, as far as the truth is known (a report, never training)."""

    @abstractmethod
    def needs_geometry(self) -> bool:
        """Whether labels are made from regions; False spares :meth:`prepare` its work."""

    @abstractmethod
    def seeds(self, scene_id: str) -> Int[np.ndarray, ' seeds'] | None:
        """Points from which the over-segmentation starts; None: it chooses."""

    # ------------------------------------------------------------------ geometry and annotated labels

    def prepared(self, scene_id: str) -> PreparedScene:
        """Regions and graph of a scene, from memory, the cache, or made now; not to be written to."""
        return self._recent.get_or_make(scene_id, lambda: self._prepared(scene_id))

    def _prepared(self, scene_id: str) -> PreparedScene:
        if scene_id not in self._keys:  # it stays as it is for the whole run
            self._keys[scene_id] = self._geometry.key(self._cloud(scene_id), self.seeds(scene_id), scene_id)
        return self._geometry.prepared(
            self._keys[scene_id], lambda: self._cloud(scene_id), lambda: self.seeds(scene_id), scene_id
        )

    def _cloud(self, scene_id: str) -> PointCloud:
        return self.source.load_cloud(self.index_of[scene_id])

    def annotated(self, scene_id: str) -> AnnotatedLabels:
        """Annotated labels of a scene."""
        return self.source.annotated_labels(self.index_of[scene_id])

    def prepare(self, jobs: int = 1) -> None:
        """Fill the geometry cache, where labels need it.

        Args:
            jobs: Processes; any joblib backend that is set (dask, say) is used.
        """
        if not self.needs_geometry():
            return
        if jobs == 1:
            for scene in tqdm(self.index_of, desc='preparing geometry'):
                self.prepared(scene)
            return
        tasks = (delayed(_prepare_one)(self, scene) for scene in self.index_of)
        done = Parallel(n_jobs=jobs, return_as='generator_unordered')(tasks)
        for _ in tqdm(done, total=len(self.index_of), desc=f'preparing geometry, {jobs} processes'):
            pass

    # ------------------------------------------------------------------ what the hook calls

    def start(self, keep: bool, log: Log = print) -> None:
        """Open the budget, prepare every scene, and write the labels of round 0.

        Args:
            keep: Go on with the budget and the rounds of an interrupted run.
            log: Told what is annotated and what round 0 labels.
        """
        self.source.open(self.store.root, resume=keep)
        log(self.source.describe())
        self.prepare()
        if not (keep and self.is_finished(0)):
            self.begin(0)
            for scene in tqdm(self.index_of, desc='labels, round 0'):
                self.refresh(0, scene, None)
            self.finish(0, log)

    def inform(self, model: Any) -> None:  # noqa: B027  most models need to know nothing
        """Tell the model what the labels say of its settings, where it asks for them."""

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
        made = self.make_labels(number, scene_id, prediction)
        self.store.write(number, scene_id, made.labels, made.ledger)

    def refresh_all(self, number: int, predictions: Iterable[tuple[str, PointPrediction]]) -> None:
        """Write the labels of every scene of this process, in the order they come; all processes enter together."""
        for scene_id, prediction in predictions:
            self.refresh(number, scene_id, prediction)

    def finish(self, number: int, log: Log = print) -> None:
        """Close a round and say how good its labels are."""
        watch = Stopwatch()
        summary = self.summarise_round(number)
        self.judging = watch.read()
        self.store.finish_round(number, summary)
        log(f'labels of round {number}: {describe_round(summary)}')


def _prepare_one(label_maker: LabelMaker, scene_id: str) -> None:
    label_maker.prepared(scene_id)
