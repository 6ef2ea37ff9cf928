"""Instances that a detector's point classes and votes make, the boxes around them, and how the three agree.

One network says three things of a scene: which class each point has, which points vote for one centre, and where boxes
are. The second gives instances, as PointGroup clusters shifted points; boxes around these can start pseudo boxes
(paper 3.4).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.ops.boxes import points_in_boxes
from rm3d_plugin.ops.clustering import ball_clusters
from rm3d_plugin.pseudo_labels.common.groups import likely_classes
from rm3d_plugin.pseudo_labels.detection.boxes import is_plausible
from rm3d_plugin.pseudo_labels.detection.objects import ObjectContext, fit_object
from rm3d_plugin.structures import Boxes3D

LINK = 0.25  # of the class's smaller horizontal size: votes nearer than this to one another are for one object
SAME = 0.5  # shared points over joint points from which an instance and a box are one object


class PredictedInstances(NamedTuple):
    """Points that vote for one centre.

    Attributes:
        point: (N,) int64 row of the instance of each point, -1 = none.
        labels: (K,) int64 classes.
        scores: (K,) mean probability of the class over the points.
    """

    point: Int[np.ndarray, ' points']
    labels: Int[np.ndarray, ' instances']
    scores: Float[np.ndarray, ' instances']


def predicted_instances(
    probabilities: Float[np.ndarray, 'points classes'],
    centers: Float[np.ndarray, 'points 3'],
    mean_sizes: Float[np.ndarray, 'things 3'],
    min_points: int,
) -> PredictedInstances:
    """Cluster the points of each object class by where they vote to.

    Args:
        probabilities: Softmax, background last; NaN where the network saw none.
        centers: Voted centres, metres; NaN where there is none.
        mean_sizes: Usual sizes, metres; NaN: the class gets no instance.
        min_points: Fewest points of an instance.
    """
    likely = likely_classes(probabilities)
    there = np.isfinite(centers).all(axis=1)
    labels: list[int] = []
    scores: list[float] = []
    point = np.full(len(likely), -1, dtype=np.int64)
    for c in np.flatnonzero(np.isfinite(mean_sizes).all(axis=1)).tolist():
        own = np.flatnonzero((likely == c) & there)
        cluster = ball_clusters(centers[own], LINK * float(min(mean_sizes[c, :2])), min_points=min_points)
        count = int(cluster.max(initial=-1)) + 1
        point[own] = np.where(cluster >= 0, len(labels) + cluster, -1)
        sums = np.bincount(cluster[cluster >= 0], probabilities[own[cluster >= 0], c], count)
        scores += (sums / np.maximum(np.bincount(cluster[cluster >= 0], minlength=count), 1)).tolist()
        labels += [c] * count
    return PredictedInstances(point, np.array(labels, dtype=np.int64), np.array(scores, dtype=np.float64))


def boxes_of_instances(context: ObjectContext, found: PredictedInstances) -> Boxes3D:
    """The box of each instance, as ``context.rules.box`` has it, with its score; none where it is too large for one."""
    order = np.argsort(found.point, kind='stable')
    starts = np.searchsorted(found.point[order], np.arange(len(found.labels) + 1))
    members = [order[a:b] for a, b in zip(starts[:-1], starts[1:], strict=True)]
    fits = [fit_object(context, own, int(c)) for own, c in zip(members, found.labels, strict=True)]
    limit, sizes = context.rules.max_excess, context.mean_sizes[found.labels]
    kept = np.array([is_plausible(fit, size, limit) for fit, size in zip(fits, sizes, strict=True)], dtype=bool)
    boxes = np.array([fit.box for fit in fits]).reshape(-1, 7)
    return Boxes3D(boxes, found.labels, found.scores).select(kept)


def agreement(
    xyz: Float[np.ndarray, 'points 3'],
    probabilities: Float[np.ndarray, 'points classes'],
    found: PredictedInstances,
    boxes: Boxes3D,
) -> dict[str, Int[np.ndarray, ' things']]:
    """How far classes, instances and boxes of a scene say the same, counted by class.

    An instance and a box are one object where they have a class, and at least half of all points that either has: of
    the box those in it that the network calls by its class.

    Args:
        xyz: Points, metres.
        probabilities: Softmax, background last; NaN where the network saw none.
        found: Instances.
        boxes: Boxes with classes.

    Returns:
        ``boxes`` and ``boxes_with_instance``, ``instances`` and ``instances_with_box``, ``points_in_boxes`` that the
        network saw and ``points_of_class`` among them, which it calls by the class of their box.
    """
    things = probabilities.shape[1] - 1
    likely, inside = likely_classes(probabilities), points_in_boxes(xyz, boxes.tensor)
    label = np.append(boxes.labels, -1)[inside]
    seen = (inside >= 0) & (likely >= 0)
    right = seen & (likely == label)
    shared = np.zeros((len(boxes), len(found.labels)), dtype=np.int64)
    both = right & (found.point >= 0)
    np.add.at(shared, (inside[both], found.point[both]), 1)
    of_box = np.bincount(inside[right], minlength=len(boxes))
    of_instance = np.bincount(found.point[found.point >= 0], minlength=len(found.labels))
    joint = of_box[:, None] + of_instance[None] - shared
    same = (boxes.labels[:, None] == found.labels[None]) & (shared >= SAME * np.maximum(joint, 1))

    def counted(labels: np.ndarray) -> Int[np.ndarray, ' things']:
        return np.bincount(labels, minlength=things)

    return {
        'boxes': counted(boxes.labels),
        'boxes_with_instance': counted(boxes.labels[same.any(axis=1)]),
        'instances': counted(found.labels),
        'instances_with_box': counted(found.labels[same.any(axis=0)]),
        'points_in_boxes': counted(label[seen]),
        'points_of_class': counted(label[right]),
    }
