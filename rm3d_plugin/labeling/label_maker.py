"""What label makers have in common: a source of annotated labels, and a store that keeps the labels of each round."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from mmengine.dist import all_gather_object, is_main_process
from tqdm import tqdm

from rm3d_plugin.labeling.data_record import check_data
from rm3d_plugin.labeling.round_summary import box_warnings, describe_round
from rm3d_plugin.labeling.sources import LabelSource
from rm3d_plugin.pseudo_labels import PointPrediction
from rm3d_plugin.registry import TASK_UTILS
from rm3d_plugin.storage import LabelStore
from rm3d_plugin.structures import LabelStatistics, PseudoLabels, Regions, SceneError

Log = Callable[[str], None]
Predictions = Iterable[tuple[str, PointPrediction]]
Task = Literal['segmentation', 'detection']


class SceneLabels(NamedTuple):
    """Labels of one scene, with the arrays of the ledger that tells how they came about (None: nothing merged)."""

    labels: PseudoLabels
    ledger: dict[str, np.ndarray] | None = None


class LabelMaker(ABC):
    """Writes the labels of the training scenes, round by round.

    A kind of label maker says how (the abstract methods); when is the hook's business.

    Args:
        store: Folder of the label store.
        source: A :class:`~rm3d_plugin.labeling.sources.LabelSource` or its config.

    Attributes:
        task: What the labels are for.
        index_of: Number of each scene in the source.
        reads_features: Whether predictions shall hold the network's features.
    """

    task: ClassVar[Task]

    def __init__(self, store: str | Path, source: Mapping[str, Any] | LabelSource) -> None:
        self.store = LabelStore(store)
        self.source: LabelSource = TASK_UTILS.build(source) if isinstance(source, Mapping) else source
        self.index_of = {scene: i for i, scene in enumerate(self.source.scene_ids)}
        self.reads_features = self.source.reads_features

    # ------------------------------------------------------------------ what a kind of label maker says

    @abstractmethod
    def prepare(self, jobs: int = 1) -> str:
        """Do what may be done once for all rounds, in so many processes; tells what was done."""

    @abstractmethod
    def statistics(self) -> LabelStatistics:
        """What the model is told of the annotated labels, and of those in use."""

    @abstractmethod
    def make_labels(self, number: int, scene_id: str, prediction: PointPrediction | None) -> SceneLabels:
        """Labels of one scene for one round; ``prediction`` is None in round 0."""

    @abstractmethod
    def look_ahead(self, number: int, predictions: Predictions) -> Predictions:
        """Read what a round needs to know before its first labels are made, and hand the same predictions on."""

    @abstractmethod
    def check(self, number: int, log: Log) -> None:
        """Take back labels of a round that turn out to be bad, before the round is closed."""

    @abstractmethod
    def evaluate(self, number: int) -> dict[str, Any]:
        """How good the labels of a round are, as far as the truth is known (a report, never training)."""

    @abstractmethod
    def regions(self, scene_id: str) -> Regions | None:
        """The regions that a scene's labels were propagated over, for reports; None: there are none."""

    @abstractmethod
    def forget(self) -> None:
        """Drop what was derived from the annotated labels: the budget has grown."""

    # ------------------------------------------------------------------ what the hook calls

    def open(self, keep: bool, log: Log = print) -> None:
        """Open the budget and prepare the scenes.

        Args:
            keep: Go on with the budget and the rounds of an interrupted run.
            log: Told what is annotated.
        """
        self.source.open(self.store.root, resume=keep)
        check_data(self.store.root, self.source, keep)
        log(self.source.describe())
        self.prepare()

    def follow(self) -> None:
        """Take up the budget that the main process has opened; in all other processes."""
        self.source.open(self.store.root, resume=True)

    def make_first_labels(self) -> None:
        """Write the labels of round 0, which ask no network."""
        self.begin(0)
        for scene in tqdm(self.index_of, desc='labels, round 0'):
            self.refresh(0, scene, None)

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

    def extend_budget(self, number: int, predictions: Predictions) -> None:
        """Let the source show more labels before a round is made; all processes enter together.

        Args:
            number: The round.
            predictions: Of the scenes of this process.
        """
        checked = self.checked(predictions)
        own = {scene: self.source.look(scene, prediction) for scene, prediction in checked}
        seen = {scene: told for part in all_gather_object(own) for scene, told in part.items()}
        self.source.extend(number, seen)
        self.forget()

    def refresh(self, number: int, scene_id: str, prediction: PointPrediction | None) -> None:
        """Write the labels of one scene for one round.

        Args:
            number: The round; 0 is made without a prediction.
            scene_id: Which scene.
            prediction: What the network says of its points.
        """
        made = self.make_labels(number, scene_id, prediction)
        self.store.write(number, scene_id, made.labels, made.ledger)

    def refresh_all(self, number: int, predictions: Predictions) -> None:
        """Write the labels of every scene of this process, in the order they come; all processes enter together."""
        for scene_id, prediction in self.look_ahead(number, self.checked(predictions)):
            self.refresh(number, scene_id, prediction)

    def checked(self, predictions: Predictions) -> Predictions:
        """The same predictions, each of which fits its scene.

        Raises:
            SceneError: A scene is none of the source, or its prediction has not a row for each of its points and a
                column for each class (and background, in detection).
        """
        sizes = {scene: entry.points for scene, entry in self.store.scenes(0).items()}
        columns = len(self.source.classes) + (self.task == 'detection')
        what = 'classes, background last' if self.task == 'detection' else 'classes'
        for scene, prediction in predictions:
            if scene not in sizes:
                raise SceneError(
                    f'scene {scene} was predicted, but is none of the {len(sizes)} that labels are made of'
                )
            if (found := prediction.probabilities.shape) != (sizes[scene], columns):
                raise SceneError(
                    f'scene {scene}: pred_point_probs: expected {sizes[scene]} rows (one a point of the scene) and '
                    f'{columns} columns ({what}), got {found}; where '
                    'the pipeline drops points, the sample needs point_index and metainfo num_points'
                )
            yield scene, prediction

    def finish(self, number: int, summary: Mapping[str, Any], log: Log = print) -> None:
        """Close a round.

        Args:
            number: The round.
            summary: What :meth:`evaluate` says of it; kept with the labels.
            log: Told it in a line.
        """
        self.store.finish_round(number, summary)
        log(f'labels of round {number}: {describe_round(dict(summary))}')
        for line in box_warnings(summary) if number else ():
            log(f'labels of round {number}: warning: {line}')
