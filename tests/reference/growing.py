"""Algorithm 1 on points, written out: dictionaries, lists, one pair at a time."""

import math


def affinity(normal_a, normal_b, descriptor_a, descriptor_b, weight_normal=1.0, weight_descriptor=1.0, normalised=True):
    """Root of the weighted squares of both cosines; a zero vector drops out."""
    squared = total = 0.0
    if any(normal_a) and any(normal_b):
        squared += weight_normal * sum(a * b for a, b in zip(normal_a, normal_b, strict=True)) ** 2
        total += weight_normal
    length = math.hypot(*descriptor_a) * math.hypot(*descriptor_b)
    if length > 0:
        cosine = sum(a * b for a, b in zip(descriptor_a, descriptor_b, strict=True)) / length
        squared += weight_descriptor * min(max(cosine, 0.0), 1.0) ** 2
        total += weight_descriptor
    if total == 0:
        return -1.0
    return math.sqrt(squared / total) if normalised else math.sqrt(squared)


def grow(xyz, normals, descriptors, curvature, seeds, neighbors, reach, threshold, zeta):
    """Region of each point; ``reach`` is a list of metres."""
    n = len(xyz)
    distance = [[math.dist(a, b) for b in xyz] for a in xyz]
    near = []
    for i in range(n):
        # The point itself takes one of the neighbors + 1 places unless as many copies of it come before.
        order = sorted(range(n), key=lambda j: (distance[i][j], j))[: neighbors + 1]  # noqa: B023
        near.append([j for j in order if j != i and distance[i][j] <= reach[i]])
    order = sorted(seeds, key=lambda i: (curvature[i], i))
    order += sorted(set(range(n)) - set(seeds), key=lambda i: (curvature[i], i))
    labels, region = {}, 0
    for start in order:
        if start in labels:
            continue
        labels[start] = region
        queue = [start]
        while queue:
            seed = queue.pop(0)
            for j in near[seed]:
                if j in labels:
                    continue
                if affinity(normals[seed], normals[j], descriptors[seed], descriptors[j]) >= threshold:
                    labels[j] = region
                    if abs(curvature[j] - curvature[seed]) <= zeta:
                        queue.append(j)
        region += 1
    return [labels[i] for i in range(n)]
