"""OTOC's rule of a round of pseudo labels."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.baselines.otoc.propagation import mean_field
from rm3d_plugin.baselines.otoc.relation import TEMPERATURE
from rm3d_plugin.labeling.accept import Accept, Accepted, confident_regions, region_means
from rm3d_plugin.ops.segment import segment_majority, segment_mean
from rm3d_plugin.pseudo_labels import PointPrediction
from rm3d_plugin.regions.prepare import PreparedScene
from rm3d_plugin.registry import TASK_UTILS


@TASK_UTILS.register_module()
class PropagatedRegions(Accept):
    """Regions of which the network is sure once their neighbours in colour, place and features were heard.

    Args:
        threshold: Least probability; larger: fewer and purer labels.
        temperature: Of the features: two unit vectors that lie so far apart are a standard deviation apart.
    """

    reads_features = True

    def __init__(self, threshold: float = 0.9, temperature: float = TEMPERATURE) -> None:
        self.threshold, self.temperature = threshold, temperature

    def __call__(
        self, prediction: PointPrediction, annotated: Int[np.ndarray, ' points'], scene: Callable[[], PreparedScene]
    ) -> Accepted:
        """The class of each region; points of no region have none.

        Raises:
            ValueError: The prediction has no features.
        """
        if prediction.features is None:
            raise ValueError(
                'PropagatedRegions: the prediction has no pred_point_features; the model must give them where its '
                'predict_features is set, as RM3DSegmentor does'
            )
        prepared = scene()
        regions = prepared.regions
        known = segment_majority(annotated, regions.labels, len(regions))
        unary = region_means(prediction.probabilities, regions)
        said = mean_field(unary, self._columns(prediction.features, prepared), known)
        return confident_regions(said, regions, self.threshold)

    def _columns(
        self, features: Float[np.ndarray, 'points channels'], scene: PreparedScene
    ) -> Float[np.ndarray, 'regions columns']:
        """Colour in [0, 1] where there is one, place in metres, and unit features over the temperature."""
        means = region_means(features, scene.regions)
        unit = means / np.maximum(np.linalg.norm(means, axis=1, keepdims=True), 1e-12)
        colours = scene.cloud.colors
        columns = [scene.graph.centroids, unit / self.temperature]
        if colours is not None:
            columns.append(segment_mean(colours, scene.regions.labels, len(scene.regions)))
        return np.concatenate(columns, axis=1)
