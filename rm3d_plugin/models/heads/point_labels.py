"""The point labels of a batch of segmentation scenes, rows joined as the points are."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from rm3d_plugin.structures import SceneError


class PointLabels(NamedTuple):
    """What training may read of the points of a batch.

    Attributes:
        semantic: (N,) class of each point, -1 = unlabelled.
        instance: (N,) instance of each point, numbered through the batch; -1 = none or unknown.
        instance_scene: (I,) scene of each instance, ascending.
        is_annotated: (N,) True where the budget annotated the class.
        class_counts: (C,) annotated labels of each class in the whole training set; None where nobody told.
        confidence: (N,) in [0, 1], how likely the class is right; None: it is sure.
    """

    semantic: Int[Tensor, ' points']
    instance: Int[Tensor, ' points']
    instance_scene: Int[Tensor, ' instances']
    is_annotated: Bool[Tensor, ' points']
    class_counts: Float[Tensor, ' classes'] | None = None
    confidence: Float[Tensor, ' points'] | None = None


def _mask(sample: Any, name: str, rows: int, fill: int | float, device: torch.device) -> Tensor:
    kind = torch.float32 if isinstance(fill, float) else torch.int64
    if name not in sample:
        return torch.full((rows,), fill, dtype=kind, device=device)
    value = torch.as_tensor(sample.get(name), dtype=kind, device=device)
    if value.shape != (rows,):
        raise SceneError(
            f'{sample.get("scene_id")}: {name}: expected {rows} values, one a point, got shape {tuple(value.shape)}'
        )
    return value


def join_point_labels(
    samples: Sequence[Any], batch_offsets: Int[Tensor, ' scenes_and_one'], num_classes: int
) -> PointLabels:
    """Join the labels of the samples of a batch.

    Points without a mask are unlabelled; labelled points without ``pts_is_annotated`` count as annotated, and those
    without ``pts_confidence`` as sure. Instance numbers of a scene may have gaps.

    Raises:
        SceneError: A mask has another number of rows than the scene has points, or names a class that is not there.
    """
    device = batch_offsets.device
    semantic, instance, is_annotated, confidence, scenes = [], [], [], [], []
    count = 0
    for scene, (sample, rows) in enumerate(zip(samples, batch_offsets.diff().tolist(), strict=True)):
        classes = _mask(sample, 'pts_semantic_mask', rows, -1, device)
        if rows and int(classes.max()) >= num_classes:
            raise SceneError(
                f'{sample.get("scene_id")}: pts_semantic_mask: expected -1..{num_classes - 1}, got class '
                f'{int(classes.max())}; num_classes of the model and classes of the data set must agree'
            )
        own = _mask(sample, 'pts_instance_mask', rows, -1, device)
        numbers, inverse = torch.unique(own[own >= 0], return_inverse=True)
        joined = torch.full_like(own, -1)
        joined[own >= 0] = inverse + count
        count += len(numbers)
        semantic.append(classes.clamp_min(-1))
        instance.append(joined)
        is_annotated.append((_mask(sample, 'pts_is_annotated', rows, 1, device) > 0) & (classes >= 0))
        confidence.append(_mask(sample, 'pts_confidence', rows, 1.0, device))
        scenes.append(torch.full((len(numbers),), scene, device=device))
    return PointLabels(
        torch.cat(semantic),
        torch.cat(instance),
        torch.cat(scenes),
        torch.cat(is_annotated),
        confidence=torch.cat(confidence),
    )
