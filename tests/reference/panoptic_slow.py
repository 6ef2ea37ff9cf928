"""Panoptic quality with sets of points, one class and one segment after the other (Kirillov et al. 2019)."""


def segments(classes, numbers, known, label):
    """Sets of points of one class by instance number."""
    out = {}
    for point in known:
        if classes[point] == label:
            out.setdefault(int(numbers[point]), set()).add(point)
    return list(out.values())


def slow_panoptic(scenes, num_classes, min_points):
    """(PQ, SQ, RQ, IoU) of each class; a scene is (found classes, found numbers, true classes, true numbers)."""
    rows = []
    for label in range(num_classes):
        overlaps, missed, wrong, both, either = [], 0, 0, 0, 0
        for semantic, instance, true_semantic, true_instance in scenes:
            known = [point for point, c in enumerate(true_semantic) if 0 <= c < num_classes]
            found = segments(semantic, instance, known, label)
            true = segments(true_semantic, true_instance, known, label)
            for mine in true:
                best = max((len(mine & other) / len(mine | other) for other in found), default=0.0)
                overlaps += [best] if best > 0.5 else []
                missed += best <= 0.5 and len(mine) >= min_points
            for other in found:
                best = max((len(mine & other) / len(mine | other) for mine in true), default=0.0)
                wrong += best <= 0.5 and len(other) >= min_points
            points, others = (set().union(*parts) for parts in (true, found))
            both, either = both + len(points & others), either + len(points | others)
        sq = sum(overlaps) / len(overlaps) if overlaps else 0.0
        rq = len(overlaps) / (len(overlaps) + missed / 2 + wrong / 2) if overlaps else 0.0
        rows.append((sq * rq, sq, rq, both / either if either else 0.0))
    return rows
