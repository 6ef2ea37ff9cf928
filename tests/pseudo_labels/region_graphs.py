"""Graphs and examples of regions in which only what is given differs."""

import numpy as np

from rm3d_plugin.pseudo_labels.region_prior.features import RegionExamples
from rm3d_plugin.structures import RegionGraph


def plain_examples(looks, classes):
    looks = np.asarray(looks, dtype=np.float64)
    return RegionExamples(looks, np.asarray(classes), np.zeros(looks.shape[1]), np.ones(looks.shape[1]))


def make_graph(count, **fields):
    plain = dict(
        centroids=np.zeros((count, 3)),
        normals=np.tile([0.0, 0, 1], (count, 1)),
        curvatures=np.zeros(count),
        descriptors=np.zeros((count, 2)),
        colors=None,
        extents=np.ones((count, 3)),
        sizes=np.ones(count, dtype=np.int64),
        edges=np.zeros((0, 2), dtype=np.int64),
    )
    return RegionGraph(**(plain | fields))
