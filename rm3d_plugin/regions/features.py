"""What a region is like: means, colour and extents of its points (METHOD 6)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numba import njit

from rm3d_plugin.ops.color import rgb_to_lab
from rm3d_plugin.ops.segment import segment_mean, segment_mean_axis
from rm3d_plugin.structures import Descriptors, PointCloud, RegionGraph, Regions, SceneError


class RegionFeatures(NamedTuple):
    """The per-region fields of :class:`rm3d_plugin.structures.RegionGraph`, under the same names."""

    centroids: Float[np.ndarray, 'regions 3']
    normals: Float[np.ndarray, 'regions 3']
    curvatures: Float[np.ndarray, ' regions']
    descriptors: Float[np.ndarray, 'regions features']
    colors: Float[np.ndarray, 'regions channels'] | None
    extents: Float[np.ndarray, 'regions 3']


def region_features(cloud: PointCloud, descriptors: Descriptors, regions: Regions) -> RegionFeatures:
    """Features of every region.

    Args:
        cloud: With normals and curvature.
        descriptors: One row a point; rows that are not valid do not count in the mean.
        regions: The partition.

    Raises:
        SceneError: Normals or curvature are missing.
        ValueError: Cloud, descriptors and regions differ in their number of points.
    """
    if cloud.normals is None or cloud.curvature is None:
        raise SceneError('region_features: PointCloud.normals and .curvature are needed; estimate them first')
    if not len(cloud) == len(descriptors) == len(regions.labels):
        raise ValueError(
            f'region_features: {len(cloud)} points, {len(descriptors)} descriptors, {len(regions.labels)} labels'
        )
    labels, count = regions.labels, len(regions)
    return RegionFeatures(
        centroids=segment_mean(cloud.xyz, labels, count),
        normals=segment_mean_axis(cloud.normals, labels, count),
        curvatures=segment_mean(cloud.curvature[:, None], labels, count)[:, 0],
        descriptors=segment_mean(descriptors.values, np.where(descriptors.valid, labels, -1), count),
        colors=region_colors(cloud, regions),
        extents=region_extents(cloud.xyz, regions),
    )


def region_colors(cloud: PointCloud, regions: Regions) -> Float[np.ndarray, 'regions channels'] | None:
    """Mean Lab colour (3 channels), else mean intensity (1 channel), else None."""
    if cloud.colors is not None:
        return segment_mean(rgb_to_lab(cloud.colors), regions.labels, len(regions))
    if cloud.intensity is not None:
        return segment_mean(cloud.intensity[:, None], regions.labels, len(regions))
    return None


def region_lengths(graph: RegionGraph) -> Float[np.ndarray, ' regions']:
    """Diagonal of each region's extents, metres."""
    return np.linalg.norm(graph.extents, axis=1)


def region_extents(xyz: Float[np.ndarray, 'points 3'], regions: Regions) -> Float[np.ndarray, 'regions 3']:
    """Length of each region along its principal axes, in metres, longest first."""
    count = len(regions)
    if count == 0:
        return np.zeros((0, 3))
    centres = segment_mean(xyz, regions.labels, count)
    axes = np.linalg.eigh(_scatter_about(xyz, regions.labels, centres))[1]
    low, high = _spans(xyz, regions.labels, centres, axes)
    return -np.sort(low - high, axis=1)


@njit(cache=True, nogil=True)
def _scatter_about(xyz: np.ndarray, labels: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """Sums of the products of coordinates about the centre of each region."""
    out = np.zeros((len(centres), 3, 3))
    d = np.empty(3)
    for p in range(len(labels)):
        r = labels[p]
        if r < 0:
            continue
        for a in range(3):
            d[a] = xyz[p, a] - centres[r, a]
        for a in range(3):
            for b in range(3):
                out[r, a, b] += d[a] * d[b]
    return out


@njit(cache=True, nogil=True)
def _spans(xyz: np.ndarray, labels: np.ndarray, centres: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest coordinate of each region's points along its axes, about its centre."""
    low, high = np.full((len(centres), 3), np.inf), np.full((len(centres), 3), -np.inf)
    for p in range(len(labels)):
        r = labels[p]
        if r < 0:
            continue
        for axis in range(3):
            along = 0.0
            for c in range(3):
                along += (xyz[p, c] - centres[r, c]) * axes[r, c, axis]
            low[r, axis], high[r, axis] = min(low[r, axis], along), max(high[r, axis], along)
    return low, high
