"""Pseudo labels of points and of objects that correct each other (TWIST, CVPR 2022)."""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from rm3d_plugin.structures import UNLABELLED


class TwoWayLabels(NamedTuple):
    """Of the points of a scene.

    Attributes:
        classes: (N,) -1 = none.
        objects: (N,) number of the accepted proposal that a point belongs to; -1 = none.
    """

    classes: Int[Tensor, ' points']
    objects: Int[Tensor, ' points']


def pooled(
    values: Float[Tensor, 'points columns'], masks: Bool[Tensor, 'objects points']
) -> Float[Tensor, 'objects columns']:
    """Mean over the points of each object; 0 for one without points."""
    return masks.to(values) @ values / masks.sum(dim=1, keepdim=True).clamp_min(1)


def two_way_labels(
    probs: Float[Tensor, 'points classes'],
    masks: Bool[Tensor, 'objects points'],
    object_probs: Float[Tensor, 'objects classes'],
    threshold: float,
) -> TwoWayLabels:
    """Points vote for the class of their object, and the object's class becomes that of its points.

    An object's probabilities are the mean of what its points say and of what its pooled features say. One that is sure
    enough gives all its points its class; among several, the one that comes last in ``masks`` yields. All other points
    keep their own class, where they are sure enough.

    Args:
        probs: Of the points, by the teacher.
        masks: Proposals, best first.
        object_probs: Of the proposals, by a classifier of their pooled features.
        threshold: Least probability; larger: fewer and purer labels.
    """
    sure, classes = probs.max(dim=1)
    classes = classes.masked_fill(sure < threshold, UNLABELLED)
    objects = torch.full_like(classes, UNLABELLED)
    shares, votes = (0.5 * (pooled(probs, masks) + object_probs)).max(dim=1)
    for number in reversed(range(len(masks))):
        if shares[number] >= threshold:
            classes[masks[number]], objects[masks[number]] = votes[number], number
    return TwoWayLabels(classes, objects)
