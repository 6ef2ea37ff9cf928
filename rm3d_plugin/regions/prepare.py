"""The geometry path: from a raw scene to its region graph."""

import warnings
from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Int

from rm3d_plugin.descriptors.base import Descriptor, virtual_viewpoint
from rm3d_plugin.ops.normals import estimate_normals
from rm3d_plugin.ops.segment import scatter_rows
from rm3d_plugin.ops.shared_octree import sharing_octree
from rm3d_plugin.oversegmentation import Oversegmenter
from rm3d_plugin.oversegmentation.base import seeds_among
from rm3d_plugin.regions.graph import build_region_graph
from rm3d_plugin.structures import Descriptors, PointCloud, RegionGraph, Regions, SceneError

TELL_FROM = 0.1  # share of a scene's points that are not described: from here on it is told


@dataclass(frozen=True, eq=False)
class PreparedScene:
    """All that label making needs to know of a scene's geometry.

    Attributes:
        cloud: With normals and curvature; both are zero for points that the over-segmenter removed as ground.
        regions: The partition; ground and discarded points have the label -1.
        graph: Its regions with features and edges.
    """

    cloud: PointCloud
    regions: Regions
    graph: RegionGraph

    def __post_init__(self) -> None:
        if len(self.regions.labels) != len(self.cloud):
            raise ValueError(f'PreparedScene: regions cover {len(self.regions.labels)} of {len(self.cloud)} points')
        if len(self.graph) != len(self.regions):
            raise ValueError(f'PreparedScene: graph of {len(self.graph)} regions, partition of {len(self.regions)}')

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Plain arrays under dotted names (``cloud.xyz``); what is None is left out."""
        out = {'regions.labels': self.regions.labels}
        for prefix, part in (('cloud', self.cloud), ('graph', self.graph)):
            values = {item.name: getattr(part, item.name) for item in fields(part)}
            out.update({f'{prefix}.{name}': np.asarray(value) for name, value in values.items() if value is not None})
        return out

    def nbytes(self) -> int:
        """Memory of all arrays."""
        return sum(values.nbytes for values in self.to_arrays().values())

    @classmethod
    def from_arrays(cls, arrays: dict[str, np.ndarray]) -> 'PreparedScene':
        """Undo :meth:`to_arrays`.

        Raises:
            SceneError: An array that every prepared scene has is missing.
        """
        needed = {'regions.labels', 'cloud.xyz', 'graph.sizes', 'graph.edges'}
        if missing := sorted(needed - set(arrays)):
            raise SceneError(
                f'PreparedScene.from_arrays: {missing} missing, got {sorted(arrays)}; prepare the scene again'
            )

        def part(prefix: str) -> dict[str, np.ndarray]:
            return {name.split('.', 1)[1]: arrays[name] for name in arrays if name.startswith(prefix + '.')}

        graph = part('graph')
        colors = graph.pop('colors', None)
        return cls(PointCloud(**part('cloud')), Regions(arrays['regions.labels']), RegionGraph(colors=colors, **graph))


def prepare_scene(
    cloud: PointCloud,
    descriptor: Descriptor,
    oversegmenter: Oversegmenter,
    graph_neighbors: int = 8,
    max_gap: float | None = None,
    seeds: Int[np.ndarray, ' seeds'] | None = None,
    name: str = 'scene',
) -> PreparedScene:
    """Ground off, normals, descriptor, over-segmentation, graph (METHOD 2, 3, 5, 6).

    Ground that the over-segmenter does not want is taken away before anything else is computed.

    Args:
        cloud: The raw scene; normals and curvature are estimated where missing.
        descriptor: Describes the points that are left.
        oversegmenter: Splits the points that are left.
        graph_neighbors: Adjacent regions that each region keeps.
        max_gap: Metres between adjacent regions; see :func:`rm3d_plugin.regions.graph.build_region_graph`.
        seeds: Numbers of labelled points, or None.
        name: Of the scene; for warnings, and for parts that read a file of each scene.

    Returns:
        The scene with one label a point of ``cloud``.

    Warns:
        UserWarning: The scene is empty or all ground; more than a tenth of what is left cannot be described (too few
            neighbours, all in one place); or a channel holds NaN or infinite values, which then count as unknown (0).
    """
    cloud = _usable_channels(cloud, name)
    kept = np.flatnonzero(~oversegmenter.find_ground(cloud))
    rest = cloud.select(kept)
    with sharing_octree(rest.xyz):
        rest = with_normals(rest)
        descriptors = descriptor.for_scene(name).compute(rest)
        _tell_undescribed(descriptors, len(cloud), type(descriptor).__name__, name)
        labels = oversegmenter.partition(rest, descriptors, seeds_among(seeds, kept, len(cloud)), name)
        regions = Regions(labels)
        graph = build_region_graph(rest, descriptors, regions, graph_neighbors, max_gap)

    assert rest.normals is not None and rest.curvature is not None
    normals = scatter_rows(rest.normals, kept, len(cloud), fill=0)
    curvature = scatter_rows(rest.curvature, kept, len(cloud), fill=0)
    everywhere = scatter_rows(regions.labels, kept, len(cloud), fill=-1)
    return PreparedScene(replace(cloud, normals=normals, curvature=curvature), Regions(everywhere), graph)


def _usable_channels(cloud: PointCloud, name: str) -> PointCloud:
    """The cloud with zeros for values that are not finite: a normal of zeros is unknown to all that follows."""
    usable: dict[str, np.ndarray] = {}
    for channel in ('colors', 'intensity', 'normals', 'curvature'):
        values = getattr(cloud, channel)
        if values is None or np.isfinite(values).all():
            continue
        bad = ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)
        usable[channel] = np.where(bad.reshape(-1, *[1] * (values.ndim - 1)), np.float32(0), values)
        warnings.warn(
            f'{name}: {channel} of {bad.sum()} of {len(bad)} points are NaN or infinite and count as 0', stacklevel=3
        )
    return replace(cloud, **usable) if usable else cloud


def _tell_undescribed(descriptors: Descriptors, total: int, kind: str, name: str) -> None:
    left = len(descriptors)
    undescribed = left - int(descriptors.valid.sum())
    if left == 0:
        text = 'the scene has no points' if total == 0 else f'all {total} points are ground, nothing is left'
    elif undescribed > TELL_FROM * left:
        text = (
            f'{undescribed} of {left} points cannot be described by {kind} (too few neighbours, or all in one place) '
            'and join regions by their normals alone; check units and density, or search a larger neighbourhood'
        )
    else:
        return
    warnings.warn(f'{name}: {text}', stacklevel=3)


def with_normals(cloud: PointCloud, neighbors: int = 20) -> PointCloud:
    """The cloud with normals and curvature, estimated from ``neighbors`` nearest points where it has none.

    Estimates turn to the sensor; where it is unknown, to a point that moves with the cloud.
    """
    if cloud.normals is not None and cloud.curvature is not None:
        return cloud
    viewpoint = virtual_viewpoint(cloud.xyz) if cloud.sensor is None else cloud.sensor
    found = estimate_normals(cloud.xyz, k=neighbors, viewpoint=viewpoint)
    normals = np.where(found.valid[:, None], found.normals, 0.0) if cloud.normals is None else cloud.normals
    curvature = found.curvature if cloud.curvature is None else cloud.curvature
    return replace(cloud, normals=normals, curvature=curvature)
