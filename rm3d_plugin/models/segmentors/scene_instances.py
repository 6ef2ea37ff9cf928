"""The instances of a scene that was predicted in one or in several chunks."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from torch import Tensor

from rm3d_plugin.models.heads.proposals import Instances
from rm3d_plugin.models.segmentors.chunks import Chunk
from rm3d_plugin.models.segmentors.stitching import ChunkInstances, stitch_instances
from rm3d_plugin.ops.clustering import mask_nms


def scene_instances(
    head: Any,
    xyz: Float[Tensor, 'points 3'],
    offsets: Float[Tensor, 'points 3'],
    probs: Float[Tensor, 'points classes'],
    thing_classes: Sequence[int],
    chunks: Sequence[Chunk],
    stitch_iou: float,
) -> Instances:
    """Look for instances chunk by chunk, join them, and drop those that a better one covers.

    Args:
        head: Has ``instances(xyz, offsets, probs, thing_classes)`` and ``rules``, as ``PointGroupHead``.
        xyz: Metres.
        offsets: Metres to the centres of instances, the mean over chunks and views.
        probs: Softmax, the mean over chunks and views.
        thing_classes: Classes that have instances.
        chunks: Of the scene; with one (or none) the head sees the whole scene.
        stitch_iou: See :func:`stitch_instances`.
    """
    if len(chunks) < 2:
        whole: Instances = head.instances(xyz, offsets, probs, thing_classes)
        return whole
    parts = []
    for chunk in chunks:
        rows = chunk.rows
        found = head.instances(xyz[rows], offsets[rows], probs[rows], thing_classes)
        parts.append(ChunkInstances(rows, found.masks, found.labels, found.scores))
    scene = stitch_instances(parts, len(xyz), stitch_iou)
    kept = mask_nms(scene.masks, scene.scores, len(xyz), head.rules.nms_iou)[: head.rules.max_instances]
    dense = np.zeros((len(kept), len(xyz)), dtype=bool)
    for row, mask in enumerate(kept):
        dense[row, scene.masks.indices[scene.masks.offsets[mask] : scene.masks.offsets[mask + 1]]] = True
    return Instances(dense, scene.labels[kept], scene.scores[kept])
