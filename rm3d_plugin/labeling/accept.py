"""Which of the network's answers become pseudo labels: the rule of a round of self-training."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.ops.segment import segment_mean
from rm3d_plugin.pseudo_labels import PointPrediction
from rm3d_plugin.regions.prepare import PreparedScene
from rm3d_plugin.registry import TASK_UTILS
from rm3d_plugin.structures import UNLABELLED, Regions


class Accepted(NamedTuple):
    """Pseudo labels of the points of a scene.

    Attributes:
        semantic: (N,) int64 class, -1 = not accepted.
        confidence: (N,) in [0, 1], 0 where nothing was accepted.
    """

    semantic: Int[np.ndarray, ' points']
    confidence: Float[np.ndarray, ' points']


class Accept(ABC):
    """Chooses pseudo labels out of a prediction.

    Attributes:
        reads_features: Whether predictions shall hold the network's features.
    """

    reads_features: ClassVar[bool] = False

    @abstractmethod
    def __call__(
        self, prediction: PointPrediction, annotated: Int[np.ndarray, ' points'], scene: Callable[[], PreparedScene]
    ) -> Accepted:
        """Choose.

        Args:
            prediction: Of the network; NaN where it saw nothing.
            annotated: (N,) class of the annotated points, -1 elsewhere.
            scene: Makes the regions of the scene and their graph, where they are needed.
        """


@TASK_UTILS.register_module()
class ConfidentPoints(Accept):
    """Points of which the network is sure, each by itself.

    Args:
        threshold: Least probability; larger: fewer and purer labels.
    """

    def __init__(self, threshold: float = 0.95) -> None:
        self.threshold = threshold

    def __call__(
        self, prediction: PointPrediction, annotated: Int[np.ndarray, ' points'], scene: Callable[[], PreparedScene]
    ) -> Accepted:
        """The most likely class where it is likely enough."""
        return confident(prediction.probabilities, self.threshold)


@TASK_UTILS.register_module()
class ConfidentRegions(Accept):
    """Regions of which the network is sure in the mean over their points; all points of one get its class.

    Args:
        threshold: Least mean probability; larger: fewer and purer labels.
    """

    def __init__(self, threshold: float = 0.9) -> None:
        self.threshold = threshold

    def __call__(
        self, prediction: PointPrediction, annotated: Int[np.ndarray, ' points'], scene: Callable[[], PreparedScene]
    ) -> Accepted:
        """The class of each region; points of no region have none."""
        regions = scene().regions
        return confident_regions(region_means(prediction.probabilities, regions), regions, self.threshold)


def region_means(values: Float[np.ndarray, 'points columns'], regions: Regions) -> Float[np.ndarray, 'regions columns']:
    """Mean over the points of each region that have a value; 0 for one without."""
    labels = np.where(np.isnan(values).any(axis=1), UNLABELLED, regions.labels)
    return segment_mean(np.nan_to_num(values), labels, len(regions))


def confident_regions(
    probabilities: Float[np.ndarray, 'regions classes'], regions: Regions, threshold: float
) -> Accepted:
    """The most likely class of each region, for all its points, where it is likely enough; points of none have none."""
    return confident(np.where(regions.labels[:, None] >= 0, probabilities[regions.labels], np.nan), threshold)


def confident(probabilities: Float[np.ndarray, 'points classes'], threshold: float) -> Accepted:
    """The most likely class of each point, where it is likely enough; NaN: nothing is known of a point."""
    known = ~np.isnan(probabilities).any(axis=1)
    shares = np.where(known[:, None], probabilities, 0.0)
    sure = shares.max(axis=1)
    taken = known & (sure >= threshold)
    semantic = np.where(taken, shares.argmax(axis=1), UNLABELLED)
    return Accepted(semantic, np.where(taken, sure, 0.0).astype(np.float32))
