"""What the propagation needs to know of a scan, whatever is labelled: computed once."""

from itertools import chain
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from rm3d_plugin.pseudo_labels.propagation.channels import channel_groups
from rm3d_plugin.pseudo_labels.propagation.learned_features import learned_features
from rm3d_plugin.pseudo_labels.propagation.neighborhoods import neighborhoods
from rm3d_plugin.pseudo_labels.propagation.point_features import point_features
from rm3d_plugin.pseudo_labels.propagation.point_graph import PointGraph, fixed_graph, measured_graph
from rm3d_plugin.pseudo_labels.propagation.region_scales import RegionScale, region_scales
from rm3d_plugin.structures import PointCloud


class PreparedCloud(NamedTuple):
    """A scan, its graphs and its regions.

    Attributes:
        cloud: As given.
        graphs: Between neighbours; a walker goes over each, and the mean of their answers counts.
        scales: Regions and their features, finest first.
        spacing: Metres, the usual distance between neighbours.
    """

    cloud: PointCloud
    graphs: tuple[PointGraph, ...]
    scales: tuple[RegionScale, ...]
    spacing: float

    @property
    def features(self) -> Float[np.ndarray, 'regions features']:
        """Of the finest regions."""
        return self.scales[0].features


def prepare_cloud(cloud: PointCloud) -> PreparedCloud:
    """Neighbours, edges and features of a scan; most of the time of a propagation is spent here."""
    near, channels = neighborhoods(cloud.xyz), channel_groups(cloud)
    graphs = measured_graph(cloud.xyz, near, channels), fixed_graph(cloud, near, channels)
    groups = chain(point_features(cloud.xyz, near, channels), learned_features(cloud))
    scales = region_scales(graphs[0], groups)
    return PreparedCloud(cloud, graphs, scales, near.spacing)
