"""Where annotated labels come from: the scenes of a data set, and what the budget shows of them."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float, Int
from tqdm import tqdm

from rm3d_plugin.datasets.base import Truth
from rm3d_plugin.label_budgets import (
    BoxAmount,
    BoxBudget,
    BudgetError,
    box_amount,
    count_points,
    draw_box_budget,
    hide,
    load_box_budget,
    save_box_budget,
)
from rm3d_plugin.pseudo_labels import AnnotatedLabels, PointPrediction
from rm3d_plugin.registry import DATASETS, TASK_UTILS
from rm3d_plugin.structures import Boxes3D, PointCloud


class LabelSource(ABC):
    """Scenes with the labels that training may see. Implement it to label the scenes of another project.

    Attributes:
        classes: Names of the classes, background left out.
        scene_ids: One name a scene.
        thing_classes: In segmentation, numbers of the classes that have instances.
        reads_features: Whether :meth:`look` shall see the network's features.
    """

    reads_features: ClassVar[bool] = False
    classes: Sequence[str]
    scene_ids: Sequence[str]
    thing_classes: Sequence[int] = ()

    @abstractmethod
    def load_cloud(self, index: int) -> PointCloud:
        """Points of scene ``index``."""

    @abstractmethod
    def annotated_labels(self, index: int) -> AnnotatedLabels:
        """Annotated labels of scene ``index``."""

    def truth(self, index: int) -> Truth | None:
        """All labels, for the report on pseudo labels only; None where nobody knows them."""
        return None

    def point_counts(self) -> Int[np.ndarray, ' classes']:
        """Annotated points of each class."""
        counts = np.zeros(len(self.classes), dtype=np.int64)
        for index in range(len(self.scene_ids)):
            semantic = self.annotated_labels(index).semantic
            counts += np.bincount(semantic[semantic >= 0], minlength=len(self.classes))
        return counts

    def describe(self) -> str:
        """What is annotated, in one or a few lines."""
        return f'{len(self.scene_ids)} scenes'

    @property
    def grown(self) -> bool:
        """Whether more is annotated than the rounds on disk know: :meth:`extend` takes it up before the next one."""
        return False

    def extends(self, number: int) -> bool:
        """Whether more is to be annotated before the labels of a round (from 1) are made; costs one more prediction."""
        return self.grown

    def look(self, scene_id: str, prediction: PointPrediction) -> Any:
        """What :meth:`extend` shall know of the prediction of a scene: how uncertain the network is of each point.

        Args:
            scene_id: Which scene.
            prediction: Of its points; gone afterwards, so what is told should be small.
        """
        return uncertainty(prediction.probabilities)

    def extend(self, number: int, seen: Mapping[str, Any]) -> None:  # noqa: B027
        """Annotate more, as in active learning, and keep it where :meth:`open` said.

        Every process calls it with the same arguments, and from then on :meth:`annotated_labels` shows the new labels
        too. A run that was interrupted may call it once more for the same round.

        Args:
            number: The round whose labels are made next.
            seen: What :meth:`look` tells of each scene.
        """

    def open(self, folder: Path, resume: bool) -> None:  # noqa: B027  a source with fixed labels has nothing to keep
        """Draw what is annotated and keep it in ``folder``, or with ``resume`` take up what is kept there."""


def uncertainty(probabilities: Float[np.ndarray, 'points classes']) -> Float[np.ndarray, ' points']:
    """Entropy of each point's softmax over the largest there is, in [0, 1]; NaN where the network saw nothing.

    >>> uncertainty(np.array([[0.5, 0.5], [1.0, 0.0], [np.nan, np.nan]])).round(2).tolist()
    [1.0, 0.0, nan]
    """
    logs = np.log(np.maximum(probabilities, 1e-12))
    return np.asarray(-(probabilities * logs).sum(axis=1) / np.log(max(probabilities.shape[1], 2)))


class DatasetSource(LabelSource):
    """The scenes of a data set; what is annotated of them is up to the subclass.

    Args:
        dataset: The training split or its config.
    """

    def __init__(self, dataset: Any) -> None:
        self.dataset = DATASETS.build(dataset) if isinstance(dataset, Mapping) else dataset
        self.classes = tuple(self.dataset.metainfo['classes'])
        self.scene_ids = list(self.dataset.scene_ids)

    def load_cloud(self, index: int) -> PointCloud:
        """Points of scene ``index``."""
        cloud: PointCloud = self.dataset.load_cloud(index)
        return cloud

    def truth(self, index: int) -> Truth | None:
        """All labels of a scene, for reports; None where nobody labelled it."""
        if not self.dataset.is_labelled(index):
            return None
        truth: Truth = self.dataset.load_truth(index)
        return truth


@TASK_UTILS.register_module()
class BoxBudgetSource(DatasetSource):
    """A few boxes of a detection data set, drawn by seed (METHOD 8).

    Args:
        dataset: The training split or its config; its truth is read here to show the drawn boxes, and for reports.
        budget: A name that :func:`~rm3d_plugin.label_budgets.box_amount` knows, or the fields of a ``BoxAmount``.
        seed: Seed of the draw.
        min_points: Boxes with fewer lidar points are never drawn.
    """

    def __init__(
        self, dataset: Any, budget: str | Mapping[str, Any] = '1pct', seed: int = 0, min_points: int = 5
    ) -> None:
        super().__init__(dataset)
        self._amount = box_amount(budget) if isinstance(budget, str) else BoxAmount(**budget)
        self._seed, self._min_points = seed, min_points
        self._budget: BoxBudget | None = None

    @property
    def budget(self) -> BoxBudget:
        """The drawn boxes; drawn at first use."""
        if self._budget is None:
            labels, points, unlabelled = {}, {}, []
            for index, scene in enumerate(tqdm(self.scene_ids, desc='drawing the label budget', leave=False)):
                truth = self.truth(index)
                boxes = Boxes3D.empty() if truth is None else truth.boxes
                unlabelled += [scene] if truth is None else []
                labels[scene] = boxes.labels
                points[scene] = count_points(self.dataset.load_cloud(index).xyz, boxes.tensor)
            self._budget = draw_box_budget(labels, self._amount, self._seed, points, self._min_points, unlabelled)
        return self._budget

    def annotated_labels(self, index: int) -> AnnotatedLabels:
        """The annotated boxes of a scene and the labels of the points in them."""
        scene, cloud = self.scene_ids[index], self.load_cloud(index)
        truth = self.truth(index) or Truth(Boxes3D.empty())
        rows = self.budget.rows(scene, len(truth.boxes))
        seen = hide(cloud.xyz, truth, rows, self.budget.is_complete(scene))
        return AnnotatedLabels(seen.semantic, seen.instance, seen.boxes, complete=seen.complete)

    def describe(self) -> str:
        """The budget's summary."""
        return self.budget.summary(self.classes)

    def open(self, folder: Path, resume: bool) -> None:
        """Write ``budget.json``, or read it.

        Raises:
            BudgetError: What is kept there is not the budget that is asked for.
        """
        if resume:
            self._budget = self._checked(load_box_budget(folder / 'budget.json'), folder)
        else:
            save_box_budget(folder / 'budget.json', self.budget)

    def _checked(self, kept: BoxBudget, folder: Path) -> BoxBudget:
        if (kept.seed, kept.amount) != (self._seed, self._amount):
            raise BudgetError(
                f'{folder / "budget.json"}: was drawn with seed {kept.seed} and {kept.amount}, but seed {self._seed} '
                f'and {self._amount} are asked for; resume with the settings of that run, or start in another work dir'
            )
        return kept
