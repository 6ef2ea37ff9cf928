"""A partition that came from elsewhere."""

from typing import final

import numpy as np
from jaxtyping import Int

from rm3d_plugin.oversegmentation.base import Oversegmenter
from rm3d_plugin.registry import OVERSEGMENTERS
from rm3d_plugin.structures import Descriptors, PointCloud


@OVERSEGMENTERS.register_module()
@final
class Precomputed(Oversegmenter):
    """Uses given labels, whatever the descriptors.

    Args:
        labels: Region of each point of the scene, -1 = discarded.
    """

    def __init__(self, labels: Int[np.ndarray, ' points']) -> None:
        super().__init__(ground=None)  # A given partition says itself what is discarded.
        self.labels = np.asarray(labels)

    def partition(
        self, cloud: PointCloud, descriptors: Descriptors, seeds: Int[np.ndarray, ' seeds'] | None = None
    ) -> Int[np.ndarray, ' points']:
        """The given labels.

        Raises:
            ValueError: They are not one a point.
        """
        if self.labels.shape != (len(cloud),):
            raise ValueError(f'Precomputed.labels: expected shape ({len(cloud)},), got {self.labels.shape}')
        return self.labels
