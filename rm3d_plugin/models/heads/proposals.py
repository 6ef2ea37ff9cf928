"""From class probabilities and shifted points to instances, without a score network (METHOD 7)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.ops.clustering import PointMasks, ball_clusters, cluster_masks, mask_nms, masks_of

Coordinates = Literal['both', 'shifted', 'original']


@dataclass(frozen=True)
class ProposalRules:
    """When points are an instance. Fit radius and counts to the density of the points: thinner scans need larger balls.

    Attributes:
        radius: Metres between linked points; larger: fewer, larger instances.
        cluster_points: Clusters with fewer points are dropped.
        min_points: A proposal needs more points than this.
        nms_iou: A proposal that overlaps a better one more than this is dropped.
        min_score: A proposal with a lower score is dropped.
        coordinates: What is clustered: the points 'shifted' to their centres, as they lie ('original'), or 'both'.
        max_instances: Most instances of a scene, best first; None: all.
    """

    radius: float = 0.03
    cluster_points: int = 50
    min_points: int = 100
    nms_iou: float = 0.3
    min_score: float = 0.0
    coordinates: Coordinates = 'both'
    max_instances: int | None = None

    def __post_init__(self) -> None:
        if self.coordinates not in get_args(Coordinates):
            raise ValueError(
                f'ProposalRules.coordinates: expected one of {get_args(Coordinates)}, got {self.coordinates!r}'
            )
        if not self.radius > 0 or self.cluster_points < 1 or self.min_points < 0:
            raise ValueError(f'ProposalRules: expected radius > 0, cluster_points >= 1, min_points >= 0, got {self}')


class Instances(NamedTuple):
    """Instances of one scene, best first.

    Attributes:
        masks: (K, n) their points.
        labels: (K,) int64 their classes.
        scores: (K,) float32 mean probability of the class over the points.
    """

    masks: Bool[np.ndarray, 'instances points']
    labels: Int[np.ndarray, ' instances']
    scores: Float[np.ndarray, ' instances']


def find_instances(
    xyz: Float[np.ndarray, 'points 3'],
    shifted: Float[np.ndarray, 'points 3'],
    probs: Float[np.ndarray, 'points classes'],
    thing_classes: Sequence[int],
    rules: ProposalRules,
) -> Instances:
    """Cluster the points of each predicted thing class, and keep the clusters that no better one covers.

    Args:
        xyz: Points, metres.
        shifted: Points moved to the predicted centres of their instances, metres.
        probs: Softmax; a point belongs to its most probable class, ties to the lowest.
        thing_classes: Classes that have instances (walls and floors do not).
        rules: Thresholds.
    """
    classes = probs.argmax(axis=1) if len(probs) else np.zeros(0, dtype=np.int64)
    groups = np.where(np.isin(classes, np.asarray(thing_classes, dtype=np.int64)), classes, -1)
    found = [] if rules.coordinates == 'original' else _clusters(shifted, groups, rules)
    found += [] if rules.coordinates == 'shifted' else _clusters(xyz, groups, rules)
    masks = masks_of([part for part in found if len(part) > rules.min_points])
    labels, scores = _scored(masks, classes, probs)
    kept = mask_nms(masks, scores, len(xyz), rules.nms_iou)
    kept = kept[scores[kept] >= rules.min_score][: rules.max_instances]
    dense = np.zeros((len(kept), len(xyz)), dtype=bool)
    for row, mask in enumerate(kept):
        dense[row, masks.indices[masks.offsets[mask] : masks.offsets[mask + 1]]] = True
    return Instances(dense, labels[kept], scores[kept])


def _clusters(points: np.ndarray, groups: np.ndarray, rules: ProposalRules) -> list[Int[np.ndarray, ' _members']]:
    masks = cluster_masks(ball_clusters(points, rules.radius, groups, rules.cluster_points))
    return np.split(masks.indices, masks.offsets[1:-1]) if len(masks.sizes) else []


def _scored(
    masks: PointMasks, classes: np.ndarray, probs: np.ndarray
) -> tuple[Int[np.ndarray, ' masks'], Float[np.ndarray, ' masks']]:
    """Class and mean probability of each mask, all of whose points are of one class.

    Single precision: means that differ by rounding alone are equal, and the mask that comes first stays.
    """
    if not len(masks.sizes):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.float32)
    labels = classes[masks.indices[masks.offsets[:-1]]].astype(np.int64)
    member = probs[masks.indices, classes[masks.indices]].astype(np.float64)
    means = np.add.reduceat(member, masks.offsets[:-1]) / masks.sizes
    return labels, means.astype(np.float32)
