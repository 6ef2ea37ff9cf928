"""A floor of square patches, four to an object, with true classes, predictions and a few annotated points."""

from dataclasses import dataclass

import numpy as np

from rm3d_plugin.pseudo_labels import AnnotatedLabels
from rm3d_plugin.structures import Boxes3D, PointCloud, RegionGraph, Regions

SIDE, POINTS, CLASSES = 8, 12, 3


@dataclass
class Patches:
    cloud: PointCloud
    regions: Regions
    graph: RegionGraph
    truth: np.ndarray
    annotated: AnnotatedLabels

    @property
    def counts(self):
        return np.bincount(self.annotated.semantic[self.annotated.semantic >= 0], minlength=CLASSES)

    def softmax(self, rng, noise=0.6):
        rows = np.full((len(self.truth), CLASSES), 0.1)
        rows[np.arange(len(rows)), self.truth] = 0.8
        patch = np.array(self.regions.labels)
        rows += noise * rng.random((SIDE * SIDE, CLASSES))[patch]
        return rows / rows.sum(axis=1, keepdims=True)


def make_patches(seed=0, share=0.03):
    rng = np.random.default_rng(seed)
    cell = np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing='ij'), axis=-1).reshape(-1, 2)
    xyz = np.concatenate([np.c_[c + rng.random((POINTS, 2)), np.zeros(POINTS)] for c in cell])
    patch = np.repeat(np.arange(SIDE * SIDE), POINTS)
    thing = (cell[:, 0] // 2) * (SIDE // 2) + cell[:, 1] // 2
    truth = rng.integers(0, CLASSES, thing.max() + 1)[thing][patch]
    gap = np.abs(cell[:, None] - cell[None]).sum(axis=2)
    count = SIDE * SIDE
    graph = RegionGraph(
        centroids=np.c_[cell + 0.5, np.zeros(count)],
        normals=np.tile([0.0, 0, 1], (count, 1)),
        curvatures=rng.random(count) / 10,
        descriptors=rng.random((count, 4)),
        colors=rng.random((count, 3)) * 30,
        extents=np.sort(rng.random((count, 3)) + 0.5, axis=1)[:, ::-1],
        sizes=np.full(count, POINTS),
        edges=np.argwhere(np.triu(gap == 1)),
    )
    known = rng.random(len(xyz)) < share
    annotated = AnnotatedLabels(np.where(known, truth, -1), np.where(known, thing[patch], -1), Boxes3D.empty())
    return Patches(PointCloud(xyz), Regions(patch), graph, truth, annotated)
