"""What Superpoint-Graph is partitioned by: eigenfeatures, and colour where wanted (METHOD 3)."""

from typing import Any, final

import numpy as np

from rm3d_plugin.descriptors.base import Descriptor
from rm3d_plugin.ops.geometric_features import geometric_features
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.structures import Descriptors, PointCloud, SceneError

PRESETS: dict[str, dict[str, Any]] = {
    'indoor': {'k': 45},  # METHOD 3
    'lidar': {'k': 45},  # nearest points reach farther by themselves where points are few
}


@DESCRIPTORS.register_module()
@final
class SuperpointGraph(Descriptor):
    """Linearity, planarity, scattering and verticality of every point, (N, 4) or (N, 7) with colours.

    Args:
        k: Nearest points besides the point itself (larger: smoother, blurs edges).
        verticality_weight: Factor on verticality, which separates floors from walls.
        colors: Append red, green and blue in [0, 1].

    Raises:
        ValueError: A number is out of range.
    """

    presets = PRESETS

    def __init__(self, k: int = 45, verticality_weight: float = 2.0, colors: bool = False) -> None:
        if k < 2 or not verticality_weight >= 0:
            raise ValueError(
                f'SuperpointGraph: expected k >= 2, verticality_weight >= 0, got {k}, {verticality_weight}'
            )
        self.k = k
        self.verticality_weight = verticality_weight
        self.colors = colors

    def compute(self, cloud: PointCloud) -> Descriptors:
        """Describe every point of a cloud.

        Raises:
            SceneError: Colours are wanted and the cloud has none.
        """
        found = geometric_features(cloud.xyz, self.k)
        values = found.values * np.array([1, 1, 1, self.verticality_weight], dtype=np.float32)
        if self.colors:
            if cloud.colors is None:
                raise SceneError('SuperpointGraph: colors=True, but PointCloud.colors is None; set colors=False')
            values = np.concatenate([values, np.where(found.valid[:, None], cloud.colors, np.float32(0))], axis=1)
        return Descriptors(values, found.valid)
