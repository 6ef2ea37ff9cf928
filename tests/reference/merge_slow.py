"""Merging of regions, written out: one pair at a time, every step looks at every edge again."""

import math


def similarity(a, b, graph, rows, weights, sigma, lambda_seg):
    """S and Sbar of one pair; ``rows`` holds a softmax row or None for each region."""
    terms = []
    if graph.colors is not None:
        squared = sum((x - y) ** 2 for x, y in zip(graph.colors[a], graph.colors[b], strict=True))
        terms.append((weights[0], math.exp(-squared / (2 * sigma**2))))
    ratios = [min(x, y) / max(x, y) for x, y in zip(graph.extents[a], graph.extents[b], strict=True)]
    terms.append((weights[1], sum(ratios) / 3))
    normal = abs(_cosine(graph.normals[a], graph.normals[b]))
    descriptor = max(_cosine(graph.descriptors[a], graph.descriptors[b]), 0)
    terms.append((weights[2], math.sqrt((normal**2 + descriptor**2) / 2)))
    if rows[a] is not None and rows[b] is not None:
        squared = sum((x - y) ** 2 for x, y in zip(rows[a], rows[b], strict=True))
        terms.append((weights[3], math.exp(-lambda_seg * squared)))
    total = sum(y * m for y, m in terms)
    norm = sum(y for y, _ in terms)
    return total, total / norm if norm else 0.0


def _cosine(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True)) / (math.hypot(*a) * math.hypot(*b))


def merge(graph, rows, labels, instances, rules, round):
    """Group of each region as a set of frozensets."""
    n = len(labels)
    t = round / rules.rounds
    weights = (1 - t, 1 - t, 1 - t, t)
    literal = rules.thresholds == 'literal'
    tau_merge, tau_seed = (x if literal else x / 2 for x in (rules.tau_merge, rules.tau_seed))
    rows = [[float(c == labels[r]) for c in range(len(rows[r]))] if labels[r] >= 0 else rows[r] for r in range(n)]
    rows = [None if any(math.isnan(x) for x in row) else list(row) for row in rows]
    fit = {}
    for a, b in graph.edges.tolist():
        if rows[a] is None or rows[b] is None:
            continue
        if not all(labels[r] >= 0 or max(rows[r]) >= rules.gamma for r in (a, b)):
            continue
        if rows[a].index(max(rows[a])) != rows[b].index(max(rows[b])):
            continue
        total, mean = similarity(a, b, graph, rows, weights, rules.color_sigma, rules.lambda_seg)
        value = total if literal else mean
        if value >= tau_merge:
            fit[a, b] = value
    group = [{r} for r in range(n)]
    flat_first = sorted(range(n), key=lambda r: (graph.curvatures[r], r))
    seeds = {r for r in range(n) if labels[r] >= 0} | set(flat_first[: math.ceil(rules.seed_share * n)])
    assigned = set(seeds)
    while True:
        offers = []
        for (a, b), value in fit.items():
            for source, target in ((a, b), (b, a)):
                open_ = target not in assigned or target in seeds
                known = {instances[r] for r in group[a] | group[b] if instances[r] >= 0}
                if source in seeds and open_ and group[a] is not group[b] and len(known) < 2:
                    offers.append((-value, a, b, source, target))
        if offers:
            negative, _, _, source, target = min(offers)
            if target not in assigned:
                assigned.add(target)
                if -negative >= tau_seed:
                    seeds.add(target)
            union = group[source] | group[target]
            for r in union:
                group[r] = union
            continue
        rest = [r for r in flat_first if r not in assigned]
        if not rest:
            return {frozenset(g) for g in group}
        seeds.add(rest[0])
        assigned.add(rest[0])
