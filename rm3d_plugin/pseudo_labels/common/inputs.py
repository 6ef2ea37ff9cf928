"""What a refresh is given: one scene, and the round it is labelled in."""

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.common.annotated import AnnotatedLabels
from rm3d_plugin.pseudo_labels.common.self_training import SelfTrainingRules
from rm3d_plugin.regions import MergeRules
from rm3d_plugin.regions.prepare import PreparedScene
from rm3d_plugin.structures import Boxes3D, PseudoLabels


@dataclass(frozen=True, eq=False)
class PointPrediction:
    """What the network says of every point of a scene; rows it did not see are NaN.

    Attributes:
        probabilities: (N, C) softmax; in detection the last class is background.
        centers: (N, 3) metres, the voted object centre, or None.
        boxes: Predicted boxes with scores, or None.
        features: (N, F) of the network, for label makers that read them, or None.
    """

    probabilities: Float[np.ndarray, 'points classes']
    centers: Float[np.ndarray, 'points 3'] | None = None
    boxes: Boxes3D | None = None
    features: Float[np.ndarray, 'points channels'] | None = None


@dataclass(frozen=True, eq=False)
class SceneInputs:
    """All that is known of one scene when its labels are made.

    Attributes:
        geometry: Points, regions and their graph.
        annotated: What the budget shows.
        prediction: What the network says; None in the first round.
        previous: Labels of the last round, or None.

    Raises:
        ValueError: A part has not one row a point of the scene.
    """

    geometry: PreparedScene
    annotated: AnnotatedLabels
    prediction: PointPrediction | None = None
    previous: PseudoLabels | None = None

    def __post_init__(self) -> None:
        self.check_rows(annotated=self.annotated, previous=self.previous)
        if self.prediction is not None:
            self.check_rows(probabilities=self.prediction.probabilities, centers=self.prediction.centers)

    def check_rows(self, **parts: np.ndarray | AnnotatedLabels | PseudoLabels | None) -> None:
        """Refuse the first part without one row a point; None passes."""
        expected = len(self.geometry.cloud)
        for name, part in parts.items():
            if part is not None and len(part) != expected:
                raise ValueError(
                    f'SceneInputs: {name} has {len(part)} rows, expected {expected} (one a point of the scene)'
                )

    @property
    def xyz(self) -> Float[np.ndarray, 'points 3']:
        """Points, metres."""
        return self.geometry.cloud.xyz

    @property
    def probabilities(self) -> Float[np.ndarray, 'points classes'] | None:
        """Softmax of the points, or None."""
        return None if self.prediction is None else self.prediction.probabilities

    @property
    def centers(self) -> Float[np.ndarray, 'points 3'] | None:
        """Shifted points, metres, or None."""
        return None if self.prediction is None else self.prediction.centers


class CommonRules(Protocol):
    """What every task's rules have."""

    @property
    def merge(self) -> MergeRules:
        """How regions merge."""

    @property
    def self_training(self) -> SelfTrainingRules | None:
        """How a round's new labels are limited, or None."""


RulesT = TypeVar('RulesT', bound=CommonRules, covariant=True)


@dataclass(frozen=True, eq=False)
class RoundContext(Generic[RulesT]):
    """What all scenes of a round share.

    Attributes:
        number: 0 .. rules.merge.rounds.
        rules: Of the task.
        class_counts: (C,) annotated labels of each class, in detection with background; breaks ties.
        thing_classes: In segmentation, classes that have instances.
    """

    number: int
    rules: RulesT
    class_counts: Int[np.ndarray, ' classes']
    thing_classes: tuple[int, ...] = ()
