"""Algorithm 1 on regions: similar, confident and agreeing neighbours become one group (METHOD 6)."""

from heapq import heappop, heappush
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.regions.ledger import MergeLedger, Reason
from rm3d_plugin.regions.rules import MergeRules
from rm3d_plugin.regions.similarity import PairTerms, pair_terms, weigh
from rm3d_plugin.structures import RegionGraph, number_by_first_point


class MergeResult(NamedTuple):
    """A coarser partition and how it came about.

    Attributes:
        group: (R,) int64 group of each region, numbered by its first region.
        ledger: One row for each edge of the graph.
    """

    group: Int[np.ndarray, ' regions']
    ledger: MergeLedger


class RegionEvidence(NamedTuple):
    """What is known of each region before merging.

    Attributes:
        probabilities: (R, C) pooled softmax; NaN rows, or no column at all, where nothing was predicted.
        labels: (R,) int64 annotated class, -1 where unknown.
        instances: (R,) int64 annotated instance, -1 where unknown.
        centers: (R, 3) pooled shifted centres, metres, NaN rows where nothing was predicted; or None.
    """

    probabilities: Float[np.ndarray, 'regions classes']
    labels: Int[np.ndarray, ' regions']
    instances: Int[np.ndarray, ' regions']
    centers: Float[np.ndarray, 'regions 3'] | None = None


class RegionClasses(NamedTuple):
    """What is believed of each region before merging.

    Attributes:
        probabilities: (R, C) pooled softmax; one-hot where the class is known, NaN where nothing is.
        classes: (R,) int64 argmax; -1 where nothing is known.
        confident: (R,) bool, pooled softmax >= gamma, or the class is known.
    """

    probabilities: Float[np.ndarray, 'regions classes']
    classes: Int[np.ndarray, ' regions']
    confident: Bool[np.ndarray, ' regions']


class Growth(NamedTuple):
    """Groups and which edges made them."""

    group: Int[np.ndarray, ' regions']
    accepted: Bool[np.ndarray, ' edges']
    became_seed: Bool[np.ndarray, ' edges']
    other_instance: Bool[np.ndarray, ' edges']


def region_classes(
    probabilities: Float[np.ndarray, 'regions classes'], labels: Int[np.ndarray, ' regions'], gamma: float
) -> RegionClasses:
    """Class and confidence of each region; an annotated label replaces what the network says."""
    rows = np.array(probabilities, dtype=np.float64)
    known = labels >= 0
    if rows.shape[1] and known.any():
        rows[known] = 0.0
        rows[np.flatnonzero(known), labels[known]] = 1.0
    seen: np.ndarray = np.isfinite(rows).all(axis=1) & (rows.shape[1] > 0)
    rows[~seen] = np.nan
    filled = np.where(seen[:, None], rows, 0.0)
    best = filled.argmax(axis=1) if rows.shape[1] else np.zeros(len(rows), dtype=np.int64)
    classes = np.where(known, labels, np.where(seen, best, -1)).astype(np.int64)
    peak = filled.max(axis=1, initial=0.0)
    return RegionClasses(rows, classes, np.asarray(known | (seen & (peak >= gamma))))


def centres_near(
    centers: Float[np.ndarray, 'regions 3'] | None,
    classes: Int[np.ndarray, ' regions'],
    edges: Int[np.ndarray, 'edges 2'],
    rules: MergeRules,
) -> Bool[np.ndarray, ' edges']:
    """Whether the shifted centres of each pair allow one instance; True where unknown or not asked."""
    if centers is None or rules.centre_distance is None:
        return np.ones(len(edges), dtype=bool)
    limit = rules.centre_limit(classes)[edges[:, 0]]
    distance = np.linalg.norm(centers[edges[:, 0]] - centers[edges[:, 1]], axis=1)
    return ~(distance >= limit)  # NaN, a region the network did not see, forbids nothing


def seed_order(
    curvatures: Float[np.ndarray, ' regions'], labels: Int[np.ndarray, ' regions'], share: float
) -> tuple[list[int], list[int]]:
    """First seeds (annotated regions and the flattest share), and all regions by rising curvature."""
    by_curvature = np.argsort(curvatures, kind='stable')
    flattest = by_curvature[: int(np.ceil(share * len(curvatures)))]
    first = np.union1d(np.flatnonzero(labels >= 0), flattest)
    return first.tolist(), by_curvature.tolist()


def grow(
    edges: Int[np.ndarray, 'edges 2'],
    value: Float[np.ndarray, ' edges'],
    allowed: Bool[np.ndarray, ' edges'],
    seed_threshold: float,
    seeds: tuple[list[int], list[int]],
    instances: Int[np.ndarray, ' regions'],
) -> Growth:
    """Best-first growth from seeds over the allowed edges.

    A region that joins lets its group grow on only if the value of its edge reaches ``seed_threshold``. Two groups
    join where both ends of an edge are seeds. Groups that hold two different annotated instances never join.

    Args:
        edges: Pairs of regions.
        value: What best means; larger first, ties to the lowest pair of regions.
        allowed: Edges that pass Condition 3.
        seed_threshold: Condition 4.
        seeds: First seeds, which compete from the start, and the order in which unassigned regions become seeds.
        instances: Annotated instance of each region, or -1.
    """
    growing = _Growing(edges, value, allowed, seed_threshold, instances)
    first, rest = seeds
    for region in first:
        growing.plant(region)
    growing.run()
    for region in rest:
        if not growing.assigned[region]:
            growing.plant(region)
            growing.run()
    return growing.result()


class _Growing:
    """State of one growth: union-find groups, seeds, and a heap of edges that seeds offer."""

    def __init__(
        self,
        edges: Int[np.ndarray, 'edges 2'],
        value: Float[np.ndarray, ' edges'],
        allowed: Bool[np.ndarray, ' edges'],
        seed_threshold: float,
        instances: Int[np.ndarray, ' regions'],
    ) -> None:
        n = len(instances)
        self.seed_threshold = seed_threshold
        self.parent = list(range(n))
        self.instance = instances.tolist()
        self.assigned = [False] * n
        self.is_seed = [False] * n
        self.heap: list[tuple[float, int, int, int, int]] = []
        self.offers: list[list[tuple[float, int, int, int]]] = [[] for _ in range(n)]
        kept = np.flatnonzero(allowed)
        for edge, a, b, v in zip(kept.tolist(), *edges[kept].T.tolist(), value[kept].tolist(), strict=True):
            self.offers[a].append((-v, a, b, edge))
            self.offers[b].append((-v, a, b, edge))
        self.accepted = np.zeros(len(edges), dtype=bool)
        self.became_seed = np.zeros(len(edges), dtype=bool)
        self.other_instance = np.zeros(len(edges), dtype=bool)

    def plant(self, region: int) -> None:
        """Make a region a seed: it is assigned, and its edges are on offer."""
        self.assigned[region] = True
        self.is_seed[region] = True
        for offer in self.offers[region]:
            heappush(self.heap, (*offer, region))

    def run(self) -> None:
        """Take the best edge on offer until none is left."""
        while self.heap:
            key, a, b, edge, source = heappop(self.heap)
            target = b if source == a else a
            if self.assigned[target] and not self.is_seed[target]:
                continue  # taken by a better edge, and its group does not grow from it
            self.join(edge, source, target, -key)

    def join(self, edge: int, source: int, target: int, value: float) -> None:
        """Join the two groups unless they are one already or hold different annotated instances."""
        a, b = self.find(source), self.find(target)
        if a == b:
            return
        if self.instance[a] >= 0 and self.instance[b] >= 0 and self.instance[a] != self.instance[b]:
            self.other_instance[edge] = True
            return
        low, high = min(a, b), max(a, b)
        self.parent[high] = low
        self.instance[low] = max(self.instance[a], self.instance[b])
        self.accepted[edge] = True
        fresh = not self.assigned[target]
        self.assigned[target] = True
        if fresh and value >= self.seed_threshold:
            self.became_seed[edge] = True
            self.plant(target)

    def find(self, region: int) -> int:
        """Lowest region of the group."""
        while self.parent[region] != region:
            self.parent[region] = self.parent[self.parent[region]]
            region = self.parent[region]
        return region

    def result(self) -> Growth:
        roots = np.array([self.find(r) for r in range(len(self.parent))], dtype=np.int64)
        return Growth(number_by_first_point(roots), self.accepted, self.became_seed, self.other_instance)


def merge(graph: RegionGraph, evidence: RegionEvidence, rules: MergeRules, round: int) -> MergeResult:
    """Merge adjacent regions under Conditions 3 and 4 (METHOD 6).

    Two neighbours merge when S reaches the threshold, both are confident (or annotated), both are of one class, their
    shifted centres are near (where the rules ask), and no two annotated instances meet. It only coarsens, and does not
    depend on the order in which edges are given.

    Args:
        graph: Features and edges of the regions.
        evidence: What is known of each.
        rules: Thresholds, terms and schedule.
        round: Where the schedule stands, 0 .. rules.rounds.

    Raises:
        ValueError: A row count does not fit the regions, or a label is not among the classes.
    """
    for name, array in evidence._asdict().items():
        if array is not None and len(array) != len(graph):
            raise ValueError(f'RegionEvidence.{name}: has {len(array)} rows, expected {len(graph)} (one a region)')
    classes, labels = evidence.probabilities.shape[1], evidence.labels
    if classes and len(labels) and labels.max() >= classes:
        raise ValueError(f'merge: labels name class {labels.max()}, but probabilities have {classes} columns')
    return decide(graph.edges, pair_terms(graph, rules), graph.curvatures, evidence, rules, round)


def decide(
    edges: Int[np.ndarray, 'edges 2'],
    terms: PairTerms,
    curvatures: Float[np.ndarray, ' regions'],
    evidence: RegionEvidence,
    rules: MergeRules,
    round: int,
) -> MergeResult:
    """Conditions 3 and 4 on what is known of regions and edges; :func:`merge` without the geometry.

    Args:
        edges: Pairs of regions.
        terms: What geometry and colour say of each.
        curvatures: Of the regions; the order of seeds.
        evidence: What is known of the regions.
        rules: Thresholds, terms and schedule.
        round: Where the schedule stands.
    """
    belief = region_classes(evidence.probabilities, evidence.labels, rules.gamma)
    similarity = weigh(terms, edges, belief.probabilities, rules, round)
    value = similarity.mean if rules.thresholds == 'normalised' else similarity.total
    refusals = _refusals(edges, value, belief, evidence.centers, rules)
    allowed = ~np.any(list(refusals.values()), axis=0)
    seeds = seed_order(curvatures, evidence.labels, rules.seed_share)
    growth = grow(edges, value, allowed, rules.seed_threshold(), seeds, evidence.instances)
    ledger = MergeLedger(
        region_a=edges[:, 0],
        region_b=edges[:, 1],
        M_color=similarity.color,
        M_scale=similarity.scale,
        M_des=similarity.descriptor,
        M_seg=similarity.semantics,
        A_n=terms.normal,
        A_des=terms.descriptor,
        S=similarity.total,
        Sbar=similarity.mean,
        threshold=np.full(len(edges), rules.merge_threshold()),
        accepted=growth.accepted,
        became_seed=growth.became_seed,
        round=np.full(len(edges), round, dtype=np.int64),
        reason=_reasons(refusals, growth, edges),
    )
    return MergeResult(growth.group, ledger)


def _refusals(
    edges: Int[np.ndarray, 'edges 2'],
    value: Float[np.ndarray, ' edges'],
    belief: RegionClasses,
    centers: Float[np.ndarray, 'regions 3'] | None,
    rules: MergeRules,
) -> dict[Reason, Bool[np.ndarray, ' edges']]:
    """Edges that fail each part of Condition 3."""
    a, b = edges[:, 0], edges[:, 1]
    return {
        Reason.NOT_CONFIDENT: ~(belief.confident[a] & belief.confident[b]),
        Reason.OTHER_CLASS: belief.classes[a] != belief.classes[b],
        Reason.NOT_SIMILAR: value < rules.merge_threshold(),
        Reason.CENTRES_APART: ~centres_near(centers, belief.classes, edges, rules),
    }


def _reasons(refusals: dict[Reason, np.ndarray], growth: Growth, edges: np.ndarray) -> Int[np.ndarray, ' edges']:
    same = growth.group[edges[:, 0]] == growth.group[edges[:, 1]]
    reason = np.where(same, int(Reason.SAME_GROUP), int(Reason.NOT_REACHED)).astype(np.int64)
    reason[growth.other_instance & ~same] = Reason.OTHER_INSTANCE
    for name, refused in reversed(refusals.items()):
        reason[refused] = name
    reason[growth.accepted] = Reason.MERGED
    return reason
