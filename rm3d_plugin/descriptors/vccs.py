"""Vox-Connect: each point is described by the supervoxel that it belongs to (Papon et al., CVPR 2013; METHOD 3)."""

from collections.abc import Mapping
from typing import Any, final

import numpy as np

from rm3d_plugin.descriptors.base import Descriptor
from rm3d_plugin.descriptors.fpfh import PRESETS as FPFH_PRESETS
from rm3d_plugin.ops.color import rgb_to_lab
from rm3d_plugin.ops.segment import segment_mean, segment_sizes
from rm3d_plugin.ops.supervoxels import VoxelDistance, supervoxels, unit_sums
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.structures import Descriptors, PointCloud

PRESETS: dict[str, dict[str, Any]] = {
    'indoor': {'base': {'type': 'FPFH', **FPFH_PRESETS['indoor']}, 'voxel_size': 0.05, 'seed_size': 0.3},  # m
    # m; voxels as wide as the rings of a 64-beam scanner are apart at some 15 m; farther off they connect no more
    'lidar': {'base': {'type': 'FPFH', **FPFH_PRESETS['lidar']}, 'voxel_size': 0.3, 'seed_size': 1.5},
}


@DESCRIPTORS.register_module()
@final
class VCCS(Descriptor):
    """Mean histogram of the supervoxel of each point, rows that sum to 1: the same for all points of a supervoxel.

    Supervoxels grow by the paper's distance on the histograms of another descriptor (FPFH in the paper), and on colour
    where there is one. Position and colour are left out of the rows, so that they compare surfaces wherever they lie. A
    point that no supervoxel reached is described by the connected voxels around it.

    Args:
        base: Config of the descriptor of points; its values must not be negative.
        voxel_size: R_voxel, metres; not below the distance between points, or nothing connects.
        seed_size: R_seed, metres between seeds (larger: smoother rows, coarser edges).
        color_weight: Weight of colour in the distance; without colours the term drops out.
        spatial_weight: Weight of the distance to the centre.
        shape_weight: Weight of the histograms.
        color_scale: Lab units that count as 1.

    Raises:
        ValueError: A number cannot be used.
    """

    presets = PRESETS
    version = 2

    def __init__(
        self,
        base: Mapping[str, Any] | None = None,
        voxel_size: float = 0.05,
        seed_size: float = 0.3,
        color_weight: float = 0.1,
        spatial_weight: float = 0.4,
        shape_weight: float = 1.0,
        color_scale: float = 15.0,
    ) -> None:
        if not seed_size > voxel_size > 0:
            raise ValueError(f'VCCS: expected seed_size > voxel_size > 0 (metres), got {seed_size} and {voxel_size}')
        self.distance = VoxelDistance('papon', color_weight, spatial_weight, shape_weight, color_scale)
        self.distance.check()
        self.base: Descriptor = DESCRIPTORS.build(dict(base or {'type': 'FPFH'}))
        self.voxel_size = voxel_size
        self.seed_size = seed_size

    def compute(self, cloud: PointCloud) -> Descriptors:
        """Describe every point of a cloud; not valid where no point of the supervoxel could be described."""
        found = self.base.compute(cloud)
        histograms = np.where(found.valid[:, None], found.values, np.float32(0))
        colors = None if cloud.colors is None else rgb_to_lab(cloud.colors)
        labels = supervoxels(cloud.xyz, colors, None, histograms, self.voxel_size, self.seed_size, self.distance).labels
        count = int(labels.max()) + 1 if len(labels) else 0
        described = np.where(found.valid, labels, -1)
        means = unit_sums(segment_mean(histograms, described, count)).astype(np.float32)
        return Descriptors(means[labels], segment_sizes(described, count)[labels] > 0)
