"""What the propagation needs to know of a scan, whatever is labelled: computed once."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from rm3d_plugin.pseudo_labels.propagation.channels import channel_groups
from rm3d_plugin.pseudo_labels.propagation.neighborhoods import neighborhoods
from rm3d_plugin.pseudo_labels.propagation.point_features import point_features
from rm3d_plugin.pseudo_labels.propagation.point_graph import PointGraph, point_graph
from rm3d_plugin.structures import PointCloud


class PreparedCloud(NamedTuple):
    """A scan, its graph and its features.

    Attributes:
        cloud: As given.
        graph: Between neighbours.
        features: (N, F) float32.
        spacing: Metres, the usual distance between neighbours.
    """

    cloud: PointCloud
    graph: PointGraph
    features: Float[np.ndarray, 'points features']
    spacing: float


def prepare_cloud(cloud: PointCloud) -> PreparedCloud:
    """Neighbours, edges and features of a scan; most of the time of a propagation is spent here."""
    near, channels = neighborhoods(cloud.xyz), channel_groups(cloud)
    return PreparedCloud(cloud, point_graph(near, channels), point_features(cloud.xyz, near, channels), near.spacing)
