"""How well a descriptor finds the same place again, and tells apart objects (protocol: Choy et al., ICCV 2019)."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.descriptors import cosine_similarity
from rm3d_plugin.evaluation.functional.rank_auc import rank_auc
from rm3d_plugin.ops.rigid_fit import move

LEAST_INLIERS = 0.05  # a pair of scans counts as matched if more than this share of its matches are right
CHUNK = 1 << 24  # similarities held at a time


def most_similar(
    queries: Float[np.ndarray, 'queries features'], rows: Float[np.ndarray, 'rows features']
) -> Int[np.ndarray, ' queries']:
    """Number of the row with the largest cosine to each query; equal ones: the lowest number.

    Args:
        queries: Of any scale.
        rows: At least one.

    Raises:
        ValueError: The features differ, or there is no row.
    """
    if queries.shape[1:] != rows.shape[1:] or not len(rows):
        raise ValueError(f'most_similar: expected rows (>= 1, {queries.shape[1]}), got {rows.shape}')
    # The nearest unit row. Around their mean, differences of nearly parallel rows survive in float32.
    first, second = _unit_rows(queries), _unit_rows(rows)
    middle = second.mean(axis=0)
    first, second = (first - middle).astype(np.float32), (second - middle).astype(np.float32)
    half = 0.5 * (second**2).sum(axis=1)
    step = max(1, CHUNK // len(rows))
    found = [(first[at : at + step] @ second.T - half).argmax(axis=1) for at in range(0, len(first), step)]
    return np.concatenate([np.zeros(0, dtype=np.int64), *found])


def _unit_rows(values: Float[np.ndarray, 'rows features']) -> Float[np.ndarray, 'rows features']:
    lengths = np.linalg.norm(values.astype(np.float64), axis=1, keepdims=True)
    return np.asarray(values / np.where(lengths > 0, lengths, 1.0))


def inlier_ratio(found: Float[np.ndarray, 'matches 3'], true: Float[np.ndarray, 'matches 3'], within: float) -> float:
    """Share of matches that lie near the true place; 0 where nothing was matched.

    Args:
        found: Place that each point was matched with, metres.
        true: Place where the point really is in the other scan.
        within: Metres that a right match may be off; 0.1 in rooms.
    """
    near = ((found.astype(np.float64) - true) ** 2).sum(axis=1) <= within**2
    return float(near.mean()) if len(near) else 0.0


def feature_match_recall(ratios: Sequence[float], least: float = LEAST_INLIERS) -> float:
    """Share of pairs of scans with an inlier ratio above ``least``; NaN without pairs.

    >>> feature_match_recall([0.04, 0.06, 0.5, 0.0])
    0.5
    """
    return float(np.mean([ratio > least for ratio in ratios])) if len(ratios) else float('nan')


def motion_rmse(
    xyz: Float[np.ndarray, 'points 3'], estimate: Float[np.ndarray, '4 4'], true: Float[np.ndarray, '4 4']
) -> float:
    """Root mean square distance (metres) of points under an estimated motion and the true one.

    Args:
        xyz: Points of the overlap, in the frame that both motions start from.
        estimate: Rigid motion.
        true: Rigid motion.
    """
    away = move(estimate, xyz.astype(np.float64)) - move(true, xyz.astype(np.float64))
    return float(np.sqrt((away**2).sum(axis=1).mean()))


def same_object_auc(
    values: Float[np.ndarray, 'regions features'],
    objects: Int[np.ndarray, ' regions'],
    edges: Int[np.ndarray, 'edges 2'],
) -> float:
    """How often two adjacent regions of one object are more alike than two adjacent regions of two objects.

    Args:
        values: Mean descriptor of each region.
        objects: Object of each region; -1 = not annotated: its edges do not count.
        edges: Pairs of adjacent regions.

    Returns:
        In [0, 1]; 0.5 = the descriptor says nothing; NaN where all edges are of one kind.
    """
    known = edges[(objects[edges] >= 0).all(axis=1)]
    first, second = known.T
    return rank_auc(cosine_similarity(values[first], values[second]), objects[first] == objects[second])
