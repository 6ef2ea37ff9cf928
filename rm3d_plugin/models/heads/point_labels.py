"""The point labels of a batch of segmentation scenes, rows joined as the points are."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from rm3d_plugin.structures import UNLABELLED, SceneError, is_nested, sample_fields
from rm3d_plugin.structures.sample_fields import need_known_field


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


def _mask(sample: Mapping[str, Any], name: str, rows: int, fill: int | float, device: torch.device) -> Tensor:
    kind = torch.float32 if isinstance(fill, float) else torch.int64
    if name not in sample:
        return torch.full((rows,), fill, dtype=kind, device=device)
    value = torch.as_tensor(sample[name], dtype=kind, device=device)
    if value.shape != (rows,):
        raise SceneError(
            f'{sample.get("scene_id")}: {name}: expected {rows} values, one a point, got shape {tuple(value.shape)}'
        )
    return value


def _classes(
    sample: Mapping[str, Any], rows: int, num_classes: int, ignore_index: int | None, device: torch.device
) -> Int[Tensor, ' points']:
    """Class of each point of a scene, -1 = unlabelled."""
    classes = _mask(sample, 'pts_semantic_mask', rows, UNLABELLED, device).clamp_min(UNLABELLED)
    if ignore_index is not None:
        classes = classes.masked_fill(classes == ignore_index, UNLABELLED)
    if rows and int(classes.max()) >= num_classes:
        raise SceneError(
            f'{sample.get("scene_id")}: pts_semantic_mask: expected -1..{num_classes - 1}, got class '
            f'{int(classes.max())}; num_classes of the model and classes of the data set must agree. Where that number '
            'means unlabelled, as in mmdetection3d, give the model ignore_index'
        )
    return classes


def join_point_labels(
    samples: Sequence[Any],
    batch_offsets: Int[Tensor, ' scenes_and_one'],
    num_classes: int,
    ignore_index: int | None = None,
) -> PointLabels:
    """Join the labels of the samples of a batch.

    Points without a mask are unlabelled; labelled points without ``pts_is_annotated`` count as annotated, and those
    without ``pts_confidence`` as sure. Instance numbers of a scene may have gaps. In samples of mmdetection3d, where
    points of no class have an instance number all the same, they are of no instance.

    Args:
        samples: One a scene; see :func:`~rm3d_plugin.structures.sample_fields`.
        batch_offsets: Rows of the scenes.
        num_classes: C.
        ignore_index: A further value that means unlabelled; -1 and below always do.

    Raises:
        SceneError: No sample has classes, or a mask has another number of rows than the scene has points, or names a
            class that is not there.
    """
    each = [sample_fields(sample) for sample in samples]
    need_known_field(each, ('pts_semantic_mask',), 'segmentation')
    device = batch_offsets.device
    semantic, instance, is_annotated, confidence, scenes = [], [], [], [], []
    count = 0
    for scene, (sample, rows) in enumerate(zip(each, batch_offsets.diff().tolist(), strict=True)):
        classes = _classes(sample, rows, num_classes, ignore_index, device)
        own = _mask(sample, 'pts_instance_mask', rows, -1, device)
        if is_nested(sample):
            own = own.masked_fill(classes < 0, UNLABELLED)
        numbers, inverse = torch.unique(own[own >= 0], return_inverse=True)
        joined = torch.full_like(own, -1)
        joined[own >= 0] = inverse + count
        count += len(numbers)
        semantic.append(classes)
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
