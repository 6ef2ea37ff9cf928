"""How alike two regions are, for every edge of a region graph at once (METHOD 6).

Every term is in [0, 1]; NaN means that the term is missing for that pair, and then it counts neither in the sum nor in
the normaliser.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.regions.rules import MergeRules, TermWeights
from rm3d_plugin.structures import RegionGraph

LAB_CHANNELS = 3


class PairTerms(NamedTuple):
    """What two regions have in common by geometry and colour alone, for each edge; NaN = missing.

    Attributes:
        color: (E,) similarity of colour.
        scale: (E,) similarity of extents.
        normal: (E,) A_n, |cosine| of the mean normals.
        descriptor: (E,) A_des, cosine of the mean descriptors.
    """

    color: Float[np.ndarray, ' edges']
    scale: Float[np.ndarray, ' edges']
    normal: Float[np.ndarray, ' edges']
    descriptor: Float[np.ndarray, ' edges']


class Similarity(NamedTuple):
    """The terms of S for each edge, and what they add up to.

    Attributes:
        color: (E,) exp(-|d|^2 / (2 sigma^2)); NaN where missing, as all terms.
        scale: (E,) mean min/max ratio of sorted extents.
        descriptor: (E,) affinity of normals and descriptors.
        semantics: (E,) exp(-lambda |p - q|^2).
        total: (E,) S, the weighted sum.
        mean: (E,) Sbar = S / (sum of the weights of the terms that are there); 0 where there is none.
    """

    color: Float[np.ndarray, ' edges']
    scale: Float[np.ndarray, ' edges']
    descriptor: Float[np.ndarray, ' edges']
    semantics: Float[np.ndarray, ' edges']
    total: Float[np.ndarray, ' edges']
    mean: Float[np.ndarray, ' edges']


def color_similarity(
    colors: Float[np.ndarray, 'regions channels'], edges: Int[np.ndarray, 'edges 2'], sigma: float
) -> Float[np.ndarray, ' edges']:
    """exp(-|difference|^2 / (2 sigma^2)) of mean Lab colour (or intensity), in the units of ``sigma``."""
    difference = colors[edges[:, 0]] - colors[edges[:, 1]]
    return np.exp(-np.einsum('ij,ij->i', difference, difference) / (2 * sigma**2))


def scale_similarity(
    extents: Float[np.ndarray, 'regions 3'], edges: Int[np.ndarray, 'edges 2']
) -> Float[np.ndarray, ' edges']:
    """Mean over the three axes of the smaller extent over the larger; two extents of zero are alike."""
    a, b = extents[edges[:, 0]], extents[edges[:, 1]]
    small, large = np.minimum(a, b), np.maximum(a, b)
    return np.where(large > 0, small / np.where(large > 0, large, 1), 1.0).mean(axis=1)


def cosine(
    vectors: Float[np.ndarray, 'regions features'], edges: Int[np.ndarray, 'edges 2']
) -> Float[np.ndarray, ' edges']:
    """Cosine of the two regions' vectors; NaN where one of them is zero."""
    length = np.linalg.norm(vectors, axis=1)
    unit = vectors / np.where(length > 0, length, 1)[:, None]
    value = np.einsum('ij,ij->i', unit[edges[:, 0]], unit[edges[:, 1]])
    return np.where((length[edges] > 0).all(axis=1), value, np.nan)


def affinity(
    normal: Float[np.ndarray, ' edges'] | None,
    descriptor: Float[np.ndarray, ' edges'] | None,
    lambda_normal: float = 1.0,
    lambda_descriptor: float = 1.0,
) -> Float[np.ndarray, ' edges']:
    """Abar = sqrt(ln An^2 + ld Ades^2) / sqrt(ln + ld), Condition 1's value (METHOD 5).

    Args:
        normal: |cosine| of the normals, or None: switched off; NaN: missing for that pair.
        descriptor: Cosine of the descriptors, clipped at 0; or None, or NaN, alike.
        lambda_normal: Weight of the normals.
        lambda_descriptor: Weight of the descriptors.

    Returns:
        In [0, 1]; NaN where neither part is there.
    """
    parts = [(np.clip(np.abs(normal), 0, 1), lambda_normal)] if normal is not None else []
    parts += [(np.clip(descriptor, 0, 1), lambda_descriptor)] if descriptor is not None else []
    if not parts:
        raise ValueError('affinity: normals and descriptors are both switched off; switch the term off instead')
    values = np.stack([value for value, _ in parts])
    weights = np.where(np.isnan(values), 0.0, np.array([weight for _, weight in parts])[:, None])
    there = weights.sum(axis=0)
    squares = (weights * np.nan_to_num(values) ** 2).sum(axis=0)
    return np.where(there > 0, np.sqrt(squares / np.where(there > 0, there, 1)), np.nan)


def descriptor_similarity(terms: PairTerms, rules: MergeRules) -> Float[np.ndarray, ' edges']:
    """M_des: affinity of the regions' normals and mean descriptors; NaN where both are missing or weigh nothing."""
    return affinity(terms.normal, terms.descriptor, rules.lambda_normal, rules.lambda_descriptor)


def semantic_similarity(
    probabilities: Float[np.ndarray, 'regions classes'], edges: Int[np.ndarray, 'edges 2'], steepness: float
) -> Float[np.ndarray, ' edges']:
    """exp(-steepness |p - q|^2) of pooled softmax rows; NaN where the network saw nothing of one of them."""
    difference = probabilities[edges[:, 0]] - probabilities[edges[:, 1]]
    return np.exp(-steepness * np.einsum('ij,ij->i', difference, difference))


def combine(terms: Float[np.ndarray, 'terms edges'], weights: TermWeights) -> tuple[np.ndarray, np.ndarray]:
    """S and Sbar of each edge; a missing (NaN) term drops out of the sum and of the normaliser.

    Args:
        terms: Rows in the order of ``weights``.
        weights: y1..y4.

    Returns:
        (E,) S and (E,) S / sum(y); 0 where no term is left.
    """
    y = np.where(np.isnan(terms), 0.0, np.array(weights)[:, None])
    total = (y * np.nan_to_num(terms)).sum(axis=0)
    norm = y.sum(axis=0)
    return total, np.where(norm > 0, total / np.where(norm > 0, norm, 1), 0.0)


def pair_terms(graph: RegionGraph, rules: MergeRules) -> PairTerms:
    """What every edge of a graph says before any weight."""
    edges = graph.edges
    color = np.full(len(edges), np.nan)
    if graph.colors is not None:
        sigma = rules.color_sigma if graph.colors.shape[1] == LAB_CHANNELS else rules.intensity_sigma
        color = color_similarity(graph.colors, edges, sigma)
    return PairTerms(
        color=color,
        scale=scale_similarity(graph.extents, edges),
        normal=np.abs(cosine(graph.normals, edges)),
        descriptor=cosine(graph.descriptors, edges),
    )


def weigh(
    terms: PairTerms,
    edges: Int[np.ndarray, 'edges 2'],
    probabilities: Float[np.ndarray, 'regions classes'],
    rules: MergeRules,
    round: int,
) -> Similarity:
    """Add the network's term, and weigh; a term that is left out is known, but weighs nothing.

    Args:
        terms: What geometry and colour say of each edge.
        edges: Pairs of regions.
        probabilities: Pooled softmax, NaN rows where the network saw nothing.
        rules: Which terms count and how.
        round: Where the weights stand in their schedule.
    """
    missing = np.full(len(edges), np.nan)
    descriptor = descriptor_similarity(terms, rules)
    semantics = semantic_similarity(probabilities, edges, rules.lambda_seg) if probabilities.shape[1] else missing
    rows = np.stack([terms.color, terms.scale, descriptor, semantics])
    total, mean = combine(rows, rules.weights(round))
    return Similarity(terms.color, terms.scale, descriptor, semantics, total, mean)
