"""Point-pair features written as the formulas read: a double loop, float64, acos and atan2 (METHOD 3)."""

from typing import NamedTuple

import numpy as np


class SlowHistogram(NamedTuple):
    """Histogram of one neighbourhood, and how many pairs lie so near to a bin edge that rounding may move them."""

    values: np.ndarray
    pairs: int
    doubtful: int


def pair_feature(p_i, n_i, p_j, n_j):
    """(theta, alpha, phi, sine of the angle between source normal and line), or None where there is no frame."""
    line = p_j - p_i
    distance = np.linalg.norm(line)
    if distance == 0:
        return None
    angle_i = np.arccos(min(abs(n_i @ line) / distance, 1.0))
    angle_j = np.arccos(min(abs(n_j @ line) / distance, 1.0))
    source, target = (n_i, n_j) if angle_i <= angle_j else (n_j, n_i)
    if angle_i > angle_j:
        line = -line
    u = source
    v = np.cross(line, u)
    sine = np.linalg.norm(v) / distance
    if sine == 0:
        return None
    v = v / np.linalg.norm(v)
    w = np.cross(u, v)
    return np.arctan2(w @ target, u @ target), v @ target, u @ line / distance, sine


def bin_of(value, low, high):
    """Number of the bin out of five."""
    return int(min(max(np.floor(5 * (value - low) / (high - low)), 0), 4))


def near_edge(value, low, high, tolerance):
    """Whether rounding may move the value over one of the four inner edges (or over +-pi, for an angle)."""
    position = 5 * (value - low) / (high - low)
    inner = np.abs(position - np.array([1, 2, 3, 4])).min() < tolerance
    return inner or (high == np.pi and min(position, 5 - position) < tolerance)


def slow_histogram(points, normals, span=None, tolerance=1e-5):
    """Histogram over all pairs i < j; with ``span`` in metres the distance is a fourth dimension."""
    points, normals = np.asarray(points, dtype=np.float64), np.asarray(normals, dtype=np.float64)
    values = np.zeros(125 if span is None else 625)
    pairs = doubtful = 0
    for i in range(len(points)):
        for j in range(i + 1, len(points)):
            feature = pair_feature(points[i], normals[i], points[j], normals[j])
            if feature is None:
                continue
            theta, alpha, phi, sine = feature
            index = bin_of(theta, -np.pi, np.pi) + 5 * bin_of(alpha, -1, 1) + 25 * bin_of(phi, -1, 1)
            reach = tolerance / sine  # a line along the normal leaves the frame to chance
            near = near_edge(theta, -np.pi, np.pi, reach) or near_edge(alpha, -1, 1, reach)
            near = near or near_edge(phi, -1, 1, tolerance)
            line = points[j] - points[i]
            near = near or abs(abs(normals[i] @ line) - abs(normals[j] @ line)) < tolerance * np.linalg.norm(line)
            if span is not None:
                distance = np.linalg.norm(line)
                index += 125 * bin_of(distance, 0, span)
                near = near or near_edge(distance, 0, span, tolerance)
            values[index] += 1
            pairs += 1
            doubtful += near
    return SlowHistogram(values / max(pairs, 1), pairs, doubtful)
