"""What a region is like: means, colour and extents of its points (METHOD 6)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from rm3d_plugin.ops.color import rgb_to_lab
from rm3d_plugin.ops.segment import segment_mean, segment_mean_axis, segment_sum
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
    labels = regions.labels
    centred = xyz.astype(np.float64) - segment_mean(xyz, labels, count)[labels]
    products = (centred[:, :, None] * centred[:, None, :]).reshape(len(xyz), 9)
    axes = np.linalg.eigh(segment_sum(products, labels, count).reshape(count, 3, 3))[1]
    along = np.einsum('ni,nij->nj', centred[regions.indices], axes[labels[regions.indices]])
    longest = np.maximum.reduceat(along, regions.offsets[:-1], axis=0)
    return -np.sort(np.minimum.reduceat(along, regions.offsets[:-1], axis=0) - longest, axis=1)
