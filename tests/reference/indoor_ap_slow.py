"""VoteNet's and mmdetection3d's AP and recall of one class, step by step over all detections."""

from rm3d_plugin.ops.boxes import rotated_iou_3d


def indoor_ap_slow(truths, found, least):
    """AP and recall.

    Args:
        truths: (M, 7) boxes of each scene.
        found: (K, 7) boxes and (K,) scores of each scene.
        least: Overlap that a hit exceeds.
    """
    flat = [
        (score, s, box) for s, (boxes, scores) in enumerate(found) for box, score in zip(boxes, scores, strict=True)
    ]
    flat.sort(key=lambda item: -item[0])
    taken = [[False] * len(boxes) for boxes in truths]
    total = sum(map(len, truths))
    recall, precision, hits = [0.0], [0.0], 0
    for rank, (_, s, box) in enumerate(flat, start=1):
        best, which = -1.0, None
        for i, overlap in enumerate(rotated_iou_3d(box[None], truths[s])[0]):
            if overlap > best:
                best, which = overlap, i
        if best > least and not taken[s][which]:
            taken[s][which] = True
            hits += 1
        recall.append(hits / total)
        precision.append(hits / rank)
    last = recall[-1]
    recall, precision = [*recall, 1.0], [*precision, 0.0]
    for i in reversed(range(len(precision) - 1)):
        precision[i] = max(precision[i], precision[i + 1])
    area = sum((recall[i + 1] - recall[i]) * precision[i + 1] for i in range(len(recall) - 1))
    return area, last
