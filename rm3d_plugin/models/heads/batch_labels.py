"""The labels of a batch, rows joined as the points are."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from rm3d_plugin.models.heads.box_coder import BoxCode
from rm3d_plugin.ops.boxes import points_in_boxes
from rm3d_plugin.structures import SceneError, is_nested, sample_fields
from rm3d_plugin.structures.sample_fields import need_known_field


class ProposalTargets(NamedTuple):
    """Targets of the proposals.

    Attributes:
        is_object: (P,) 1 near a (pseudo) box, 0 otherwise.
        weights: (P,) in [0, 1], how far ``is_object`` is known: 1 for a positive; 0 between near and far; the known
            share of the grouped points for one far from every box.
        positives: (K,) rows of the proposals near a box.
        boxes: (K,) the box of each positive.
        code: Regression targets of the positives.
    """

    is_object: Int[Tensor, ' proposals']
    weights: Float[Tensor, ' proposals']
    positives: Int[Tensor, ' positives']
    boxes: Int[Tensor, ' positives']
    code: BoxCode


class FitPairs(NamedTuple):
    """Boxes with what an IoU head says of them and what is true.

    Attributes:
        logits: (K,) log odds of the overlap.
        ious: (K,) overlap with their true box, in [0, 1].
    """

    logits: Float[Tensor, ' pairs']
    ious: Float[Tensor, ' pairs']


class BatchLabels(NamedTuple):
    """What training may read of a batch of scenes.

    Attributes:
        boxes: (M, 7) boxes of all scenes.
        classes: (M,) their classes.
        box_is_annotated: (M,) True for an annotated box, False for a pseudo box.
        box_offsets: (B + 1,) rows of the scenes among the boxes.
        semantic: (N,) class of each point; the number of box classes = background, -1 = unknown.
        instance: (N,) row of ``boxes`` that holds the point, -1 = none or unknown.
        targets: What the proposals of the network should say, once it made them.
        fit_pairs: Boxes with what an IoU head said of their overlap and what is true, where the network has one.
    """

    boxes: Float[Tensor, 'boxes 7']
    classes: Int[Tensor, ' boxes']
    box_is_annotated: Bool[Tensor, ' boxes']
    box_offsets: Int[Tensor, ' scenes_and_one']
    semantic: Int[Tensor, ' points']
    instance: Int[Tensor, ' points']
    targets: ProposalTargets | None = None
    fit_pairs: FitPairs | None = None


def _field(sample: Mapping[str, Any], name: str, rows: int, fill: int, like: Tensor) -> Tensor:
    """A field of a sample as a tensor; ``fill`` in every row where it is absent."""
    if name not in sample:
        return torch.full((rows,), fill, device=like.device).to(like.dtype)
    value = torch.as_tensor(sample[name], device=like.device).to(like.dtype)
    if len(value) != rows:
        raise SceneError(f'{sample.get("scene_id")}: {name}: expected {rows} rows, got {len(value)}')
    return value


def _by_scene(samples: Sequence[Any], xyz: Tensor, batch_offsets: Tensor) -> Iterator[tuple[Any, Tensor]]:
    yield from zip(samples, xyz.split(batch_offsets.diff().tolist()), strict=True)


def _with_masks(sample: Any, xyz: Float[Tensor, 'points 3'], num_classes: int) -> dict[str, Any]:
    """Fields of a sample; one of mmdetection3d gets masks from its boxes."""
    fields = sample_fields(sample)
    if not is_nested(sample) or 'gt_bboxes_3d' not in fields:
        return fields
    boxes, classes = fields['gt_bboxes_3d'], torch.as_tensor(fields['gt_labels_3d'])
    owner = torch.from_numpy(points_in_boxes(xyz.double().cpu().numpy(), boxes.double().cpu().numpy()))
    semantic = torch.full_like(owner, num_classes)
    semantic[owner >= 0] = classes.cpu()[owner[owner >= 0]]
    return fields | {'pts_instance_mask': owner, 'pts_semantic_mask': semantic}


def join_labels(
    samples: Sequence[Any],
    batch_offsets: Int[Tensor, ' scenes_and_one'],
    xyz: Float[Tensor, 'points 3'],
    num_classes: int,
) -> BatchLabels:
    """Join the labels of the samples of a batch.

    Points without a mask are unknown; boxes without ``gt_is_annotated`` are true. In samples of mmdetection3d, which
    hold every box of their scene and masks that are not about them, the points in a box are its points and all others
    background.

    Args:
        samples: One a scene; see :func:`~rm3d_plugin.structures.sample_fields`.
        batch_offsets: Rows of the scenes.
        xyz: Metres.
        num_classes: Box classes.

    Raises:
        SceneError: No sample has boxes or classes of points, or a field has another number of rows than the scene has
            points or boxes.
    """
    each = [_with_masks(sample, points, num_classes) for sample, points in _by_scene(samples, xyz, batch_offsets)]
    need_known_field(each, ('gt_bboxes_3d', 'pts_semantic_mask', 'pts_instance_mask'), 'detection')
    device = batch_offsets.device
    real, whole = torch.zeros(0, device=device), torch.zeros(0, dtype=torch.int64, device=device)
    flag = torch.zeros(0, dtype=torch.bool, device=device)
    parts: list[tuple[Tensor, ...]] = []
    first = 0
    for sample, rows in zip(each, batch_offsets.diff().tolist(), strict=True):
        given = sample.get('gt_bboxes_3d', real)
        boxes = torch.as_tensor(given, device=device).to(torch.float32).reshape(-1, 7)
        classes = _field(sample, 'gt_labels_3d', len(boxes), 0, whole)
        semantic = _field(sample, 'pts_semantic_mask', rows, -1, whole)
        instance = _field(sample, 'pts_instance_mask', rows, -1, whole)
        if rows and int(instance.max()) >= len(boxes):
            raise SceneError(
                f'{sample.get("scene_id")}: pts_instance_mask names box {int(instance.max())} of {len(boxes)}'
            )
        instance = torch.where(instance >= 0, instance + first, -1)
        parts.append((boxes, classes, _field(sample, 'gt_is_annotated', len(boxes), 1, flag), semantic, instance))
        first += len(boxes)
    boxes, classes, box_is_annotated, semantic, instance = (torch.cat(column) for column in zip(*parts, strict=True))
    counts = torch.tensor([0] + [len(part[0]) for part in parts], device=device)
    return BatchLabels(boxes, classes, box_is_annotated, counts.cumsum(0), semantic, instance)
