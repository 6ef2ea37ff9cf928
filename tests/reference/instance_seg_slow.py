"""Instance scores with sets of points and one loop for each step, as the reference programs describe them.

A scene is (semantic, instance, found) with found = [(set of points, class, score)].
"""


def true_instances(semantic, instance, classes):
    """{(class, number): set of points}."""
    out = {}
    for point, (c, i) in enumerate(zip(semantic, instance, strict=True)):
        if c in classes and i >= 0:
            out.setdefault((c, i), set()).add(point)
    return out


def iou(a, b):
    return len(a & b) / len(a | b)


def scannet_ap(scenes, label, classes, overlap, min_points):
    """Average precision of one class: every true instance looks for its prediction (the official direction)."""
    flags = []
    missed = 0
    any_truth = False
    for semantic, instance, found in scenes:
        truth = true_instances(semantic, instance, classes)
        void = {p for p in range(len(semantic))} - set().union(*truth.values(), set())
        own = {key: points for key, points in truth.items() if key[0] == label}
        mine = [(p, s, n) for n, (p, c, s) in enumerate(found) if c == label and len(p) >= max(min_points, 1)]
        used = set()
        for key in sorted(own):
            points = own[key]
            if len(points) < min_points:
                continue
            any_truth = True
            fits = [(s, n) for p, s, n in mine if iou(p, points) > overlap and n not in used]
            if not fits:
                missed += 1
                continue
            best = max(fits, key=lambda f: (f[0], -f[1]))
            flags.append((best[0], 1))
            flags += [(s, 0) for s, n in fits if n != best[1]]
            used |= {n for _, n in fits}
        for p, s, n in mine:
            if n in used or any(iou(p, points) > overlap for points in own.values()):
                continue
            ignored = len(p & void) + sum(len(p & q) for q in own.values() if len(q) < min_points)
            if ignored / len(p) <= overlap:
                flags.append((s, 0))
    if not any_truth:
        return None
    total = missed + sum(hit for _, hit in flags)
    curve = [(0.0, 1.0)]
    for threshold in sorted({s for s, _ in flags}, reverse=True):
        kept = [hit for s, hit in flags if s >= threshold]
        curve.append((sum(kept) / total, sum(kept) / len(kept)))
    return sum((r1 - r0) * (p0 + p1) / 2 for (r0, p0), (r1, p1) in zip(curve, curve[1:], strict=False))


def s3dis(scenes, label, classes, overlap=0.5, asis=False):
    """Precision, recall, coverage and weighted coverage of one class, or None without truth."""
    hits = found_total = truth_total = 0
    coverage, weighted = [], []
    for semantic, instance, found in scenes:
        known = {p for p, c in enumerate(semantic) if 0 <= c < 255}
        own = [points for key, points in sorted(true_instances(semantic, instance, classes).items()) if key[0] == label]
        mine = [(p & known, s) for p, c, s in found if c == label and p & known]
        found_total, truth_total = found_total + len(mine), truth_total + len(own)
        if asis:
            hits += sum(any(iou(p, q) >= overlap for q in own) for p, _ in mine)
        else:
            taken = set()
            for p, _ in sorted(mine, key=lambda m: -m[1]):
                fits = [(iou(p, q), -k) for k, q in enumerate(own) if k not in taken and iou(p, q) > overlap]
                if fits:
                    taken.add(-max(fits)[1])
                    hits += 1
        if own:
            best = [max([iou(p, q) for p, _ in mine], default=0.0) for q in own]
            coverage.append(sum(best) / len(best))
            weighted.append(sum(b * len(q) for b, q in zip(best, own, strict=True)) / sum(len(q) for q in own))
    if not truth_total:
        return None
    precision = hits / found_total if found_total else 0.0
    return precision, hits / truth_total, sum(coverage) / len(coverage), sum(weighted) / len(weighted)
