"""Labels of segmentation that spread as a random walker would carry them: the default."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float, Int
from mmengine.dist import all_gather_object

from rm3d_plugin.labeling.annotated import annotated_only, evaluate_points
from rm3d_plugin.labeling.label_maker import LabelMaker, Log, Predictions, SceneLabels, Task
from rm3d_plugin.labeling.prepared_scenes import PreparedScenes
from rm3d_plugin.labeling.scan_knowledge import ScanKnowledge
from rm3d_plugin.labeling.sources import LabelSource
from rm3d_plugin.pseudo_labels import AnnotatedLabels, PointPrediction
from rm3d_plugin.pseudo_labels.common.kernel_classifier import evenly_chosen
from rm3d_plugin.pseudo_labels.propagation import (
    PreparedCloud,
    WalkerRules,
    prepare_cloud,
    propagate_prepared,
)
from rm3d_plugin.pseudo_labels.propagation.instances import spread_instances
from rm3d_plugin.pseudo_labels.propagation.network import Trial, judge_network, trial_of
from rm3d_plugin.pseudo_labels.propagation.propagate import labels_of
from rm3d_plugin.pseudo_labels.propagation.rules import SILENT, NetworkSay
from rm3d_plugin.registry import TASK_UTILS
from rm3d_plugin.storage.recent import RecentItems
from rm3d_plugin.structures import UNLABELLED, Boxes3D, LabelStatistics, PointCloud, PseudoLabels, Regions
from rm3d_plugin.structures.check_field import check_field

SCANS_IN_MEMORY = 1024  # MB of prepared scans
SAMPLE = 1 << 16  # points of all scans that the estimate is made from, about
SAMPLE_OF_SCAN = 1 << 10  # of each scan, at least
JUDGING_SCANS = 16  # whose predictions are held at once, in each process, to judge the network


@dataclass(frozen=True)
class WalkerLabelRules:
    """How labels that spread are used.

    Attributes:
        accept: Points whose class is right with less than this probability stay without a label; the probability is
            that of labels that were left out. Larger: fewer and purer labels. 0: every point has one.
        judging: Share of the labels that training is not told until the last refresh: they judge the network.
            Larger: the network is judged better, and taught less. 0: it has no say.
    """

    accept: float = 0.5
    judging: float = 0.2

    def __post_init__(self) -> None:
        check_field(self, 'accept', 0 <= self.accept <= 1, 'a probability')
        check_field(self, 'judging', 0 <= self.judging < 1, 'a share in [0, 1)')


@TASK_UTILS.register_module()
class WalkerLabelMaker(LabelMaker):
    """Labels of each scan spread over its points (:mod:`rm3d_plugin.pseudo_labels.propagation`).

    Labels of all scans teach what classes look like, and, left out in turn, how far answers may be trusted. From round
    1 on the network is a witness of its own, if labels that neither was told come out likelier with it; else the labels
    of round 0 stand.

    Args:
        store: Folder of the label store.
        source: A :class:`~rm3d_plugin.labeling.sources.LabelSource` or its config.
        rounds: Sets of labels in the whole run; the last is made from all labels, those that judged among them.
        walker: Fields of :class:`WalkerLabelRules`.
        random_walk: Fields of :class:`~rm3d_plugin.pseudo_labels.propagation.WalkerRules`.
        instances: Whether instances spread, too.
        seed: Of the draw of the labels that judge.
        geometry: Arguments of :class:`~rm3d_plugin.labeling.prepared_scenes.PreparedScenes`, of regions for reports.
    """

    task: ClassVar[Task] = 'segmentation'

    def __init__(
        self,
        store: str | Path,
        source: Mapping[str, Any] | LabelSource,
        rounds: int = 1,
        walker: Mapping[str, Any] | None = None,
        random_walk: Mapping[str, Any] | None = None,
        instances: bool = False,
        seed: int = 0,
        **geometry: Any,
    ) -> None:
        super().__init__(store, source)
        self.rules, self.walk = WalkerLabelRules(**(walker or {})), WalkerRules(**(random_walk or {}))
        self._rounds, self._objects, self._seed = rounds, instances, seed
        self._regions = PreparedScenes(self._cloud, lambda scene_id: None, **geometry)
        self._scans: RecentItems[PreparedCloud] = RecentItems(SCANS_IN_MEMORY, _nbytes)
        self._say = SILENT
        self._samples: list[Float[np.ndarray, 'points classes']] = []
        self.forget()

    def _cloud(self, scene_id: str) -> PointCloud:
        return self.source.load_cloud(self.index_of[scene_id])

    def scan(self, scene_id: str) -> PreparedCloud:
        """Graph and features of a scan, from memory or made now; not to be written to."""
        return self._scans.get_or_make(scene_id, lambda: prepare_cloud(self._cloud(scene_id)))

    def prepare(self, jobs: int = 1) -> str:
        """Nothing is kept on disk: a scan is prepared when its labels spread."""
        return 'graphs of the scans are made as they are needed'

    def forget(self) -> None:
        """What the labels tell is learnt anew."""
        scenes, classes = list(self.index_of), len(self.source.classes)
        self.known = ScanKnowledge(
            scenes, self._cloud, self.scan, self._shown, classes, self.walk, self.rules.judging, self._seed
        )

    # ------------------------------------------------------------------ annotated labels

    def annotated(self, scene_id: str) -> AnnotatedLabels:
        """Annotated labels of a scene, all of them."""
        return self.source.annotated_labels(self.index_of[scene_id])

    def told(self, number: int, scene_id: str) -> AnnotatedLabels:
        """Annotated labels from which those of a round are made: all of them where no network is judged after it."""
        annotated = self.annotated(scene_id)
        if annotated.complete or number >= self._rounds - 1:
            return annotated
        return without(annotated, self.known.judges[scene_id])

    def _shown(self, scene_id: str) -> Int[np.ndarray, ' points']:
        """Class of each annotated point, -1 elsewhere; of a complete scene a few of each class stand for all."""
        annotated = self.annotated(scene_id)
        return few_of_each(annotated.semantic, self.walk.examples) if annotated.complete else annotated.semantic

    def statistics(self) -> LabelStatistics:
        """How often each class is annotated."""
        return LabelStatistics(self.source.point_counts())

    # ------------------------------------------------------------------ labels

    def begin(self, number: int) -> None:
        """Forget the answers of the round before."""
        super().begin(number)
        self._samples = []

    def make_labels(self, number: int, scene_id: str, prediction: PointPrediction | None) -> SceneLabels:
        """Spread the labels of a scene; the network takes part as it was judged."""
        annotated = self.told(number, scene_id)
        if annotated.complete:
            return SceneLabels(annotated_only(annotated))
        if self._stands(number):
            return SceneLabels(self.store.read(scene_id, number - 1))  # nothing is known that was not before
        beside = replace(self.known.beside(scene_id), sharpness=self.known.sharpness, say=self._say)
        if prediction is not None:
            beside = replace(beside, network=prediction.probabilities)
        classes = len(self.source.classes)
        found = propagate_prepared(self.scan(scene_id), annotated.semantic, classes, self.walk, beside)
        known = annotated.semantic >= 0
        sure = known | (found.confidence >= self.rules.accept)
        some = max(SAMPLE // len(self.index_of), SAMPLE_OF_SCAN)
        self._samples.append(found.probabilities[~known][:: -(-len(known) // some)])
        semantic = np.where(sure, found.semantic, UNLABELLED)
        labels = PseudoLabels(
            semantic=semantic,
            instance=self._instances(scene_id, semantic, annotated) if self._objects else annotated.instance,
            point_is_annotated=known,
            confidence=np.where(sure, found.confidence, 0.0).astype(np.float32),
            boxes=Boxes3D.empty(),
            box_is_annotated=np.zeros(0, dtype=bool),
            likeliest=found.semantic,
        )
        return SceneLabels(labels)

    def _stands(self, number: int) -> bool:
        """Whether the labels of the round before stand: of geometry alone and the same labels, as this round's are."""
        if not 0 < number < self._rounds - 1 or self._say.weight:
            return False
        before = self._before(number)
        return before.get('network_weight') == 0 and bool(before['annotated'] == self.known.count)

    def _before(self, number: int) -> dict[str, Any]:
        """Of the round before, from the store: a run that was interrupted goes on as another does."""
        return self.store.summary(number - 1)

    def _instances(
        self, scene_id: str, semantic: Int[np.ndarray, ' points'], annotated: AnnotatedLabels
    ) -> Int[np.ndarray, ' points']:
        thing = np.isin(semantic, np.asarray(self.source.thing_classes, dtype=np.int64))
        found = spread_instances(self.scan(scene_id), semantic, np.where(thing, annotated.instance, UNLABELLED))
        return np.where(annotated.semantic >= 0, annotated.instance, np.where(thing, found, UNLABELLED))

    def look_ahead(self, number: int, predictions: Predictions) -> Predictions:
        """Labels that the network was not taught judge it, in the first scenes of each process."""
        rest = iter(predictions)
        first = list(islice(rest, JUDGING_SCANS)) if self.rules.judging else []
        trials = [trial for scene, seen in first if (trial := self._trial(number, scene, seen)) is not None]
        says: list[NetworkSay] = all_gather_object(judge_network(trials, self.walk))
        self._say = max(says, key=lambda say: say.labels)
        return chain(first, rest)

    def _trial(self, number: int, scene_id: str, prediction: PointPrediction) -> Trial | None:
        """What the network says of labels that no round before taught it, be it that they were added since."""
        annotated = self.annotated(scene_id)
        if annotated.complete:
            return None
        scene, classes = self.scan(scene_id), len(self.source.classes)
        present, labels = labels_of(scene, annotated.semantic, classes, self.known.beside(scene_id))
        taught = [self.store.read(scene_id, before).point_is_annotated for before in range(number)]
        unseen = (annotated.semantic >= 0) & ~np.any(taught, axis=0)
        return trial_of(scene, labels, prediction.probabilities[:, present], unseen)

    def check(self, number: int, log: Log) -> None:
        """Say whether the network took part."""
        if number:
            log(f'labels of round {number}: {heard(self._say)}')

    def evaluate(self, number: int) -> dict[str, Any]:
        """Coverage and precision, an estimate, and what this round's labels came from.

        Returns:
            See :func:`evaluate_points`; ``estimate``: what left-out labels tell of the mean IoU (None: too few, or
            every scene is complete); ``network_weight``: of the network, 0: no say; ``annotated``: labels there were.
        """
        estimate = self._before(number)['estimate'] if self._stands(number) else self._estimate()
        origin = {'network_weight': self._say.weight, 'annotated': self.known.count}
        return evaluate_points(self, number) | {'estimate': estimate} | origin

    def _estimate(self) -> dict[str, float] | None:
        """Of the answers of this process since the round began, percent."""
        found = self.known.estimate(self._samples) if self._samples else None
        if found is None:
            return None
        return {'miou': found.miou, 'low': found.low, 'high': found.high, 'clicks': found.labels}

    def regions(self, scene_id: str) -> Regions | None:
        """Regions of the scan, made for reports alone; None for a scene of which everything is annotated."""
        return None if self.annotated(scene_id).complete else self._regions.get(scene_id).regions


def heard(say: NetworkSay) -> str:
    """Whether a network took part, and who judged it.

    >>> heard(SILENT)
    'no label can judge the network: those of geometry stand'
    """
    if not say.labels:
        return 'no label can judge the network: those of geometry stand'
    if not say.weight:
        return f'{say.labels} labels that the network was not taught do not speak for it: those of geometry stand'
    return f'{say.labels} labels that the network was not taught speak for it: weight {say.weight:.2g}'


def without(annotated: AnnotatedLabels, points: Int[np.ndarray, ' points']) -> AnnotatedLabels:
    """The labels without those of some points."""
    semantic, instance = annotated.semantic.copy(), annotated.instance.copy()
    semantic[points], instance[points] = UNLABELLED, UNLABELLED
    return replace(annotated, semantic=semantic, instance=instance)


def few_of_each(semantic: Int[np.ndarray, ' points'], most: int) -> Int[np.ndarray, ' points']:
    """At most so many labels of each class, spread evenly over the points; -1 elsewhere."""
    known = np.flatnonzero(semantic >= 0)
    kept = known[evenly_chosen(semantic[known], most)]
    out = np.full(len(semantic), UNLABELLED, dtype=np.int64)
    out[kept] = semantic[kept]
    return out


def _nbytes(scene: PreparedCloud) -> int:
    return sum(graph.weights.data.nbytes + graph.weights.indices.nbytes for graph in scene.graphs)
