"""How well regions keep to objects: boundary recall and precision, and the best labels they allow (METHOD 9)."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Integer

from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.ops.segment import segment_majority

IGNORED = (-1, 255)  # true labels that say nothing, where they are no class


@dataclass(frozen=True, eq=False)
class BoundaryCounts:
    """What boundary scores are made of; scenes are added up with ``+``.

    Attributes:
        true_edges: Edges of the graph between two objects.
        recalled: Those that lie within tolerance of an edge between two regions.
        region_edges: Edges between two regions.
        confirmed: Those that lie within tolerance of an edge between two objects.
        confusion: (C, C + 1) points of each class by the class that their region is given; last column: discarded.
        regions: Regions of all scenes.
    """

    true_edges: int
    recalled: int
    region_edges: int
    confirmed: int
    confusion: Int[np.ndarray, 'classes classes_and_one']
    regions: int

    def __add__(self, other: 'BoundaryCounts') -> 'BoundaryCounts':
        return BoundaryCounts(
            self.true_edges + other.true_edges,
            self.recalled + other.recalled,
            self.region_edges + other.region_edges,
            self.confirmed + other.confirmed,
            self.confusion + other.confusion,
            self.regions + other.regions,
        )


class BoundaryScores(NamedTuple):
    """Scores of a partition, shares in [0, 1].

    Attributes:
        recall: Share of true boundary edges that the regions have; 1 where there is no true boundary.
        precision: Share of region boundary edges that are true; 1 where the regions have no boundary.
        f1: Harmonic mean of the two.
        oracle_miou: Mean over the classes present of the IoU, if each region took its most frequent class.
        oracle_iou: (C,) of each class; NaN where it has no point.
        oracle_accuracy: Share of labelled points whose region takes their class.
        regions: How many.
    """

    recall: float
    precision: float
    f1: float
    oracle_miou: float
    oracle_iou: Float[np.ndarray, ' classes']
    oracle_accuracy: float
    regions: int


def boundary_scores(
    xyz: Float[np.ndarray, 'points 3'],
    classes: Integer[np.ndarray, ' points'],
    regions: Integer[np.ndarray, ' points'],
    num_classes: int,
    objects: Integer[np.ndarray, ' points'] | None = None,
    neighbors: int = 5,
    tolerance: int = 1,
) -> BoundaryScores:
    """Score the partition of one scene; see :func:`boundary_counts` for the arguments."""
    return scores_of(boundary_counts(xyz, classes, regions, num_classes, objects, neighbors, tolerance))


def boundary_counts(
    xyz: Float[np.ndarray, 'points 3'],
    classes: Integer[np.ndarray, ' points'],
    regions: Integer[np.ndarray, ' points'],
    num_classes: int,
    objects: Integer[np.ndarray, ' points'] | None = None,
    neighbors: int = 5,
    tolerance: int = 1,
) -> BoundaryCounts:
    """Compare the boundaries of regions and objects on the graph of nearest neighbours (Landrieu and Boussaha 2019).

    An edge is within one edge of another when they share a point.

    Args:
        xyz: (N, 3) metres.
        classes: True class 0..C-1 of each point, of any integer type; -1 and, up to 255 classes, 255 are ignored: edges
            that touch them count nowhere.
        regions: Region of each point; -1 = discarded, which is never the correct class.
        num_classes: C.
        objects: True object of each point where known, -1 = none: the class's stuff, which is one object for each
            class. None: classes have the boundaries.
        neighbors: Nearest points that each point is joined to.
        tolerance: Edges that a boundary may be off.

    Raises:
        ValueError: A length differs, a class is out of range, or a number is not usable.
    """
    classes, regions = np.asarray(classes).astype(np.int64), _numbered(np.asarray(regions))
    if not len(xyz) == len(classes) == len(regions) or (objects is not None and len(objects) != len(xyz)):
        raise ValueError(
            f'boundary_counts: {len(xyz)} points, {len(classes)} classes, {len(regions)} regions'
            + ('' if objects is None else f', {len(objects)} objects')
        )
    if neighbors < 1 or tolerance < 0:
        raise ValueError(f'boundary_counts: expected neighbors >= 1, tolerance >= 0, got {neighbors}, {tolerance}')
    known = ~np.isin(classes, [value for value in IGNORED if not 0 <= value < num_classes])
    if known.any() and not 0 <= classes[known].min() <= classes[known].max() < num_classes:
        span = f'{classes[known].min()}..{classes[known].max()}'
        raise ValueError(f'boundary_counts: classes: expected 0..{num_classes - 1}, -1 or 255, got {span}')
    edges = neighbor_edges(xyz, neighbors)
    edges = edges[known[edges].all(axis=1)]
    owner = classes if objects is None else _owners(classes, np.asarray(objects))
    true = owner[edges[:, 0]] != owner[edges[:, 1]]
    found = regions[edges[:, 0]] != regions[edges[:, 1]]
    return BoundaryCounts(
        true_edges=int(true.sum()),
        recalled=int((true & _widened(edges, found, len(xyz), tolerance)).sum()),
        region_edges=int(found.sum()),
        confirmed=int((found & _widened(edges, true, len(xyz), tolerance)).sum()),
        confusion=_oracle_confusion(np.where(known, classes, -1), regions, num_classes),
        regions=len(np.unique(regions[regions >= 0])),
    )


def _owners(classes: Int[np.ndarray, ' points'], objects: Integer[np.ndarray, ' points']) -> Int[np.ndarray, ' points']:
    """A number from 0 for each object, and below 0 for what each class has beside objects."""
    return np.where(objects < 0, -1 - classes.astype(np.int64), _numbered(objects))


def _numbered(values: Integer[np.ndarray, ' points']) -> Int[np.ndarray, ' points']:
    """Numbers from 0 for values of any integer type, which hashes of 64 bits fill; -1 for what is below 0."""
    return np.where(values < 0, -1, np.unique(values, return_inverse=True)[1].reshape(-1))


def scores_of(counts: BoundaryCounts) -> BoundaryScores:
    """Turn the counts of one scene or of many into shares."""
    recall = counts.recalled / counts.true_edges if counts.true_edges else 1.0
    precision = counts.confirmed / counts.region_edges if counts.region_edges else 1.0
    hits = np.diagonal(counts.confusion).astype(np.float64)
    points = counts.confusion.sum(axis=1)
    union = points + counts.confusion[:, :-1].sum(axis=0) - hits
    iou = np.where(points > 0, hits / np.maximum(union, 1), np.nan)
    return BoundaryScores(
        recall=recall,
        precision=precision,
        f1=2 * recall * precision / (recall + precision) if recall + precision else 0.0,
        oracle_miou=float(iou[points > 0].mean()) if points.any() else float('nan'),
        oracle_iou=iou,
        oracle_accuracy=float(hits.sum() / points.sum()) if points.any() else float('nan'),
        regions=counts.regions,
    )


def neighbor_edges(xyz: Float[np.ndarray, 'points 3'], neighbors: int) -> Int[np.ndarray, 'edges 2']:
    """Pairs i < j where one is among the other's nearest points, each once, sorted."""
    near = Octree(xyz).knn(xyz, neighbors + 1).indices.astype(np.int64)
    rows = np.arange(len(xyz))[:, None]
    # A point comes among its own neighbours, unless as many copies of it come before; then the last is one too many.
    spare = (near == rows).any(axis=1)
    near[~spare, -1] = -1
    keep = (near >= 0) & (near != rows)
    a, b = np.broadcast_to(rows, near.shape)[keep], near[keep]
    keys = np.unique(np.minimum(a, b) * len(xyz) + np.maximum(a, b))
    return np.stack([keys // max(len(xyz), 1), keys % max(len(xyz), 1)], axis=1)


def _widened(
    edges: Int[np.ndarray, 'edges 2'], chosen: Bool[np.ndarray, ' edges'], points: int, tolerance: int
) -> Bool[np.ndarray, ' edges']:
    """The chosen edges and those that reach one of them over at most ``tolerance`` shared points."""
    for _ in range(tolerance):
        touched = np.zeros(points, dtype=np.bool_)
        touched[edges[chosen]] = True
        chosen = touched[edges].any(axis=1)
    return chosen


def _oracle_confusion(
    classes: Int[np.ndarray, ' points'], regions: Int[np.ndarray, ' points'], num_classes: int
) -> Int[np.ndarray, 'classes classes_and_one']:
    """Points of each class by the most frequent class of their region (ties: the lower class)."""
    _, region = np.unique(regions, return_inverse=True)
    region = np.where(regions >= 0, region, -1)
    majority = segment_majority(classes, region, int(region.max()) + 1 if len(region) else 0)
    given = np.where(region >= 0, np.append(majority, -1)[region], num_classes)
    known = classes >= 0
    cells = classes[known] * (num_classes + 1) + given[known]
    return np.bincount(cells, minlength=num_classes * (num_classes + 1)).reshape(num_classes, num_classes + 1)
