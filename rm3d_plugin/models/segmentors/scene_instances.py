"""The instances of a scene that was predicted in one or in several chunks."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from torch import Tensor

from rm3d_plugin.models.heads.proposals import Instances
from rm3d_plugin.models.segmentors.scene_reader import ReadScene
from rm3d_plugin.models.segmentors.stitching import ChunkInstances, stitch_instances
from rm3d_plugin.ops.clustering import mask_nms


def scene_instances(
    head: Any,
    scene: ReadScene,
    probs: Float[Tensor, 'points classes'],
    thing_classes: Sequence[int],
    stitch_iou: float,
) -> Instances:
    """Look for instances chunk by chunk, join them, and drop those that a better one covers.

    Args:
        head: Has ``instances(xyz, offsets, probs, thing_classes)`` and ``rules``, as ``PointGroupHead``.
        scene: With offsets. Read in one chunk (or none), the head sees it whole.
        probs: Its class probabilities, settled.
        thing_classes: Classes that have instances.
        stitch_iou: See :func:`stitch_instances`.
    """
    xyz, offsets = scene.xyz, scene.offsets
    assert offsets is not None
    if len(scene.chunks) < 2:
        whole: Instances = head.instances(xyz, offsets, probs, thing_classes)
        return whole
    parts = []
    for chunk in scene.chunks:
        rows = chunk.rows
        found = head.instances(xyz[rows], offsets[rows], probs[rows], thing_classes)
        parts.append(ChunkInstances(rows, found.masks, found.labels, found.scores))
    joined = stitch_instances(parts, len(xyz), stitch_iou)
    kept = mask_nms(joined.masks, joined.scores, len(xyz), head.rules.nms_iou)[: head.rules.max_instances]
    dense = np.zeros((len(kept), len(xyz)), dtype=bool)
    for row, mask in enumerate(kept):
        dense[row, joined.masks.indices[joined.masks.offsets[mask] : joined.masks.offsets[mask + 1]]] = True
    return Instances(dense, joined.labels[kept], joined.scores[kept])
