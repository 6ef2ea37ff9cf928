"""From groups of an object class to the pseudo boxes of a scene (METHOD 7)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.ops.rotated_iou import rotated_iou_bev
from rm3d_plugin.pseudo_labels.common.groups import GroupLabels
from rm3d_plugin.pseudo_labels.detection.boxes import BoxFit, complete_box, is_plausible, suppress, tight_box
from rm3d_plugin.pseudo_labels.detection.rules import ObjectRules
from rm3d_plugin.structures import Boxes3D

VOTE_RADIUS = 0.75  # of the class's smaller horizontal size: votes nearer than this are for one object
MAX_VOTES = 3000


class EarlierObjects(NamedTuple):
    """Pseudo boxes of the last round that still stand.

    Attributes:
        boxes: The boxes.
        point_box: (N,) int64 row of the box that each point belonged to, -1 = none.
    """

    boxes: Boxes3D
    point_box: Int[np.ndarray, ' points']


class Objects(NamedTuple):
    """Pseudo boxes of a scene.

    Attributes:
        boxes: Kept boxes; the score is the confidence of the group.
        point_box: (N,) int64 row of the box that each point belongs to, -1 = none.
        rejected: (N,) bool, points of groups that are larger than their class allows.
        counts: 'pseudo_boxes', 'rejected_groups' (too large), 'joined_fragments', 'small_groups' (too few points),
            'partial_groups' (too little to see), 'doubtful_groups' (score under the limit), 'suppressed_boxes'.
        candidates: Every plausible object with its score, before scores are held against the limits.
        steps: Step -> (C,) candidates of each class that it cost, in order; 'found' is how many there were at first.
    """

    boxes: Boxes3D
    point_box: Int[np.ndarray, ' points']
    rejected: Bool[np.ndarray, ' points']
    counts: dict[str, float]
    candidates: Boxes3D = Boxes3D.empty()
    steps: dict[str, Int[np.ndarray, ' classes']] = {}


class PointVotes(NamedTuple):
    """What the network says of single points; it helps where a group is not exactly one object.

    Attributes:
        classes: (N,) int64 most likely class, -1 = not seen.
        centers: (N, 3) voted object centre in metres, NaN = not seen; or None.
    """

    classes: Int[np.ndarray, ' points']
    centers: Float[np.ndarray, 'points 3'] | None


class Evidence(NamedTuple):
    """What beside the points speaks for an object.

    Attributes:
        boxes: Boxes that the network predicts, with scores; or None.
        limits: (C,) score that a pseudo box of each class needs; or None: any.
    """

    boxes: Boxes3D | None = None
    limits: Float[np.ndarray, ' classes'] | None = None


NO_EVIDENCE = Evidence()


class _Candidate(NamedTuple):
    """Points taken for one object, from one group or from several fragments."""

    groups: tuple[int, ...]
    members: np.ndarray
    label: int
    score: float
    fit: BoxFit


class ObjectContext(NamedTuple):
    """What every fit of a box needs.

    Attributes:
        xyz: (N, 3) points, metres.
        mean_sizes: (C, 3) usual sizes, metres; NaN: the class gets no box. Classes beyond are background.
        ground_z: (N,) height of the ground under each point, metres, or None.
        sensor: Position of the sensor from above, metres.
        votes: What the network says of single points.
        rules: Thresholds.
    """

    xyz: Float[np.ndarray, 'points 3']
    mean_sizes: Float[np.ndarray, 'classes 3']
    ground_z: Float[np.ndarray, ' points'] | None
    sensor: tuple[float, float]
    votes: PointVotes
    rules: ObjectRules


class PointGroups(NamedTuple):
    """Groups that may be objects.

    Attributes:
        points: (N,) group of each point that may belong to a pseudo box, -1 for the others.
        labels: Class and confidence of each group.
    """

    points: Int[np.ndarray, ' points']
    labels: GroupLabels


def find_objects(
    context: ObjectContext,
    groups: PointGroups,
    annotated_boxes: Boxes3D,
    earlier: EarlierObjects | None = None,
    evidence: Evidence = NO_EVIDENCE,
) -> Objects:
    """A box for every group of an object class that is plausible and has its place to itself.

    Fragments of one object, boxes of one class that overlap and whose points together are still no larger than the
    class allows, become one box. Then more points win over fewer, and new boxes over those of the last round, which
    only fill gaps.

    Args:
        context: Points, sizes and thresholds.
        groups: Which points belong together, and what they are.
        annotated_boxes: These always win.
        earlier: Boxes of the last round.
        evidence: What else speaks for an object.
    """
    rules, wanted = context.rules, _wanted(groups.labels, context.mean_sizes)
    found, rejected, too_large = _candidates_of(context, groups, wanted)
    joined = _join_fragments(context, found)
    large_enough = [c for c in joined if len(c.members) >= rules.min_points]
    whole = [c for c in large_enough if _shows_enough(context, c)]
    scored = _scored(whole, evidence.boxes, rules.support_iou)
    trusted = scored if evidence.limits is None else [c for c in scored if c.score >= evidence.limits[c.label]]
    if evidence.limits is not None:  # what is no pseudo box has no label either
        rejected |= (groups.points >= 0) & np.append(wanted, False)[groups.points]
    _set_members(rejected, large_enough, True)
    _set_members(rejected, trusted, False)
    boxes, point_box, lost = _compete(len(context.xyz), trusted, annotated_boxes, earlier, rules)
    counts = {
        'pseudo_boxes': float(len(boxes)),
        'rejected_groups': float(len(too_large)),
        'joined_fragments': float(len(found) - len(joined)),
        'small_groups': float(len(joined) - len(large_enough)),
        'partial_groups': float(len(large_enough) - len(whole)),
        'doubtful_groups': float(len(scored) - len(trusted)),
        'suppressed_boxes': float(lost),
    }
    steps = _steps(context, found, too_large, (joined, large_enough, whole, trusted), boxes)
    return Objects(boxes, point_box, rejected, counts, _as_boxes(scored), steps)


def _steps(
    context: ObjectContext,
    found: list[_Candidate],
    too_large: list[int],
    left: tuple[list[_Candidate], ...],
    boxes: Boxes3D,
) -> dict[str, Int[np.ndarray, ' classes']]:
    """How many candidates of each class every step cost; old boxes that come back may make the last one negative."""
    classes = len(context.mean_sizes)
    at = [np.bincount([c.label for c in part], minlength=classes) for part in (found, *left)]
    large = np.bincount(too_large, minlength=classes)
    at.append(np.bincount(boxes.labels, minlength=classes))
    names = ('joined', 'points', 'shown', 'score', 'collision')
    lost = {name: before - after for name, before, after in zip(names, at[:-1], at[1:], strict=True)}
    return {'found': at[0] + large, 'size': large, **lost}


def _wanted(groups: GroupLabels, mean_sizes: Float[np.ndarray, 'classes 3']) -> Bool[np.ndarray, ' groups']:
    """Groups of an object class whose size is known."""
    usable = np.append(np.isfinite(mean_sizes).all(axis=1), [False])
    background = len(mean_sizes)
    return usable[np.where((groups.classes >= 0) & (groups.classes < background), groups.classes, background)]


def _candidates_of(
    context: ObjectContext, groups: PointGroups, wanted: Bool[np.ndarray, ' groups']
) -> tuple[list[_Candidate], Bool[np.ndarray, ' points'], list[int]]:
    """Candidates of the wanted groups; points of groups that are too large for any, and the classes of those groups."""
    labels = groups.labels
    order = np.argsort(groups.points, kind='stable')
    starts = np.searchsorted(groups.points[order], np.arange(len(labels.classes) + 1))
    found: list[_Candidate] = []
    rejected = np.zeros(len(context.xyz), dtype=bool)
    too_large: list[int] = []
    for group in np.flatnonzero(wanted).tolist():
        members = order[starts[group] : starts[group + 1]]
        if len(members):
            own = _candidates(context, group, members, int(labels.classes[group]), float(labels.confidence[group]))
            found += own
            if not own:
                rejected[members] = True
                too_large.append(int(labels.classes[group]))
    return found, rejected, too_large


def _set_members(mask: Bool[np.ndarray, ' points'], candidates: list[_Candidate], value: bool) -> None:
    """Write into the rows of the candidates' points, in place."""
    for candidate in candidates:
        mask[candidate.members] = value


def _as_boxes(candidates: list[_Candidate]) -> Boxes3D:
    """Boxes, classes and scores of the candidates."""
    return Boxes3D(
        np.array([c.fit.box for c in candidates]).reshape(-1, 7),
        np.array([c.label for c in candidates], dtype=np.int64),
        np.array([c.score for c in candidates], dtype=np.float64),
    )


def _shows_enough(context: ObjectContext, candidate: _Candidate) -> bool:
    """Whether the points reach as high and as far as the visible part of such an object does."""
    rules, prior, label = context.rules, context.mean_sizes[candidate.label], candidate.label
    z = context.xyz[candidate.members, 2]
    bottom = z.min() if context.ground_z is None else np.median(context.ground_z[candidate.members])
    high = rules.seen_height is None or z.max() - bottom >= rules.seen_height[label] * prior[2]
    return bool(high and (rules.seen_length is None or candidate.fit.span[0] >= rules.seen_length[label] * prior[0]))


def _scored(candidates: list[_Candidate], boxes: Boxes3D | None, support_iou: float | None) -> list[_Candidate]:
    """The candidates with the score that points and predicted boxes give them together."""
    if boxes is None or support_iou is None or not candidates:
        return candidates
    assert boxes.scores is not None
    overlap = rotated_iou_bev(np.array([c.fit.box for c in candidates]), boxes.tensor)
    same = np.array([c.label for c in candidates])[:, None] == boxes.labels[None]
    best = np.where(same & (overlap >= support_iou), boxes.scores[None], 0.0).max(axis=1, initial=0.0)
    return [c._replace(score=float(np.sqrt(c.score * b))) for c, b in zip(candidates, best, strict=True)]


def score_limits(
    candidates: Boxes3D,
    num_classes: int,
    top_fraction: tuple[float, ...],
    number: int,
    most: Float[np.ndarray, ' classes'] | None = None,
) -> Float[np.ndarray, ' classes']:
    """The score from which a candidate is among the best of its class, over all scenes.

    Args:
        candidates: Of all scenes, with scores.
        num_classes: C.
        top_fraction: See :class:`ObjectRules`.
        number: Round, 1 = the first with predictions.
        most: (C,) candidates that may be among the best, infinity where there is no limit; None: nowhere.

    Returns:
        (C,); 0 for a class without candidates, infinity for one whose candidates all have a score of 0.
    """
    assert candidates.scores is not None
    share = top_fraction[min(max(number, 1), len(top_fraction)) - 1]
    of_class = [np.sort(candidates.scores[candidates.labels == c])[::-1] for c in range(num_classes)]
    limits = np.array([np.quantile(s, 1.0 - share, method='higher') if len(s) else 0.0 for s in of_class])
    for c, scores in enumerate(of_class):
        if len(scores):  # a score of 0 is no object, however large the share
            limits[c] = max(limits[c], scores[scores > 0].min(initial=np.inf))
        if most is not None and most[c] < len(scores):
            limits[c] = max(limits[c], scores[max(int(most[c]), 1) - 1])
    return limits


def most_boxes(
    found: Sequence[Sequence[int]], annotated: Int[np.ndarray, ' classes'], growth: float
) -> Float[np.ndarray, ' classes']:
    """Most pseudo boxes of each class: ``growth`` times those of the first round that had any; infinite before it.

    A network that learns from its own boxes confirms them, and finds more in every round, right or not.

    Args:
        found: Pseudo boxes of each class, round by round.
        annotated: (C,) annotated boxes; they count in place of the first pseudo boxes where there are more of them.
        growth: 1 or more.

    >>> most_boxes([[0, 5], [3, 9]], np.array([2, 8]), growth=2.0).tolist()
    [6.0, 16.0]
    """
    most = np.full(len(annotated), np.inf)
    for boxes in reversed(found):
        most = np.where(np.array(boxes) > 0, growth * np.maximum(boxes, annotated), most)
    return most


def _candidates(context: ObjectContext, group: int, members: np.ndarray, label: int, score: float) -> list[_Candidate]:
    """The group as one object; where it is too large for one, as several by the centres its points vote for."""
    classes = context.votes.classes[members]
    sure = members[(classes == label) | (classes < 0)]
    sure = sure if len(sure) else members
    prior, limit = context.mean_sizes[label], context.rules.max_excess
    whole = _Candidate((group,), sure, label, score, fit_object(context, sure, label))
    if is_plausible(whole.fit, prior, limit):
        return [whole]
    if context.votes.centers is None:
        return []
    parts = split_by_votes(context.votes.centers[sure], VOTE_RADIUS * float(min(prior[:2])))
    out = []
    for part in range(int(parts.max(initial=-1)) + 1):
        chosen = sure[parts == part]
        if len(chosen) >= context.rules.min_points:
            out.append(_Candidate((group,), chosen, label, score, fit_object(context, chosen, label)))
    return [candidate for candidate in out if is_plausible(candidate.fit, prior, limit)]


def split_by_votes(centers: Float[np.ndarray, 'points 3'], radius: float) -> Int[np.ndarray, ' points']:
    """Take the densest place among the voted centres with all votes around it, and again until none is left.

    Args:
        centers: Votes, metres; only x and y count. NaN: no vote.
        radius: Reach of a place, metres.

    Returns:
        (N,) int64 part of each point, most votes first (tie: the lowest point); -1 without a vote, and for all where
        there are more than 3000 votes, which no object within reach has.
    """
    part = np.full(len(centers), -1, dtype=np.int64)
    voting = np.flatnonzero(np.isfinite(centers).all(axis=1))
    if len(voting) > MAX_VOTES:
        return part
    xy = centers[voting, :2].astype(np.float64)
    near = np.square(xy[:, None] - xy[None]).sum(axis=2) <= radius**2
    number = 0
    left = np.ones(len(voting), dtype=bool)
    while left.any():
        support = np.where(left, near[:, left].sum(axis=1), -1)
        taken = near[int(support.argmax())] & left
        part[voting[taken]] = number
        left &= ~taken
        number += 1
    return part


def fit_object(context: ObjectContext, members: np.ndarray, label: int) -> BoxFit:
    """The box of these points (rows of the scene) if they are one object of a class, as the rules have it."""
    points = context.xyz[members]
    if context.rules.box != 'completed':
        box = tight_box(points, context.rules.box == 'tight', context.sensor)
        return BoxFit(box, box[3:6], 0.0)
    ground = None if context.ground_z is None else float(np.median(context.ground_z[members]))
    return complete_box(points, context.mean_sizes[label], ground, context.sensor)


def _join_fragments(context: ObjectContext, found: list[_Candidate]) -> list[_Candidate]:
    """Join overlapping candidates of one class while together they are plausible, the one with most points first."""
    waiting = sorted(found, key=lambda c: (-len(c.members), c.groups))
    joined = []
    while waiting:
        current, waiting = waiting[0], waiting[1:]
        position = 0
        while position < len(waiting):
            union = _union(context, current, waiting[position])
            if union is None:
                position += 1
            else:  # the larger box may now reach a fragment that was passed over
                current, waiting, position = union, waiting[:position] + waiting[position + 1 :], 0
        joined.append(current)
    return joined


def _union(context: ObjectContext, a: _Candidate, b: _Candidate) -> _Candidate | None:
    """Both as one object, or None where they are two."""
    if a.label != b.label or np.hypot(*(a.fit.box[:2] - b.fit.box[:2])) > np.hypot(*a.fit.box[3:5]):
        return None
    if rotated_iou_bev(a.fit.box[None], b.fit.box[None])[0, 0] <= context.rules.max_iou:
        return None
    members = np.sort(np.concatenate([a.members, b.members]))
    fit = fit_object(context, members, a.label)
    if not is_plausible(fit, context.mean_sizes[a.label], context.rules.max_excess):
        return None
    score = (a.score * len(a.members) + b.score * len(b.members)) / len(members)
    return _Candidate(a.groups + b.groups, members, a.label, score, fit)


def _compete(
    points: int,
    found: list[_Candidate],
    annotated_boxes: Boxes3D,
    earlier: EarlierObjects | None,
    rules: ObjectRules,
) -> tuple[Boxes3D, Int[np.ndarray, ' points'], int]:
    """The boxes that keep their place, and each point's row of them; a point follows its box to the one that won."""
    old = EarlierObjects(Boxes3D.empty(), np.full(points, -1)) if earlier is None else earlier
    assert old.boxes.scores is not None
    candidates = Boxes3D(
        np.concatenate([np.array([f.fit.box for f in found]).reshape(-1, 7), old.boxes.tensor]),
        np.concatenate([np.array([f.label for f in found], dtype=np.int64), old.boxes.labels]),
        np.concatenate([np.array([f.score for f in found], dtype=np.float64), old.boxes.scores]),
    )
    priority = np.concatenate([np.array([len(f.members) for f in found], dtype=np.float64), old.boxes.scores - 1])
    winner = suppress(candidates, priority, annotated_boxes, rules.max_iou)
    kept = winner == np.arange(len(candidates))
    row = np.append(np.where(kept, np.cumsum(kept) - 1, -1), -1)
    same_class = np.append(candidates.labels, -1)[winner] == candidates.labels
    target = np.append(np.where(same_class, row[winner], -1), -1)
    claimed = np.where(old.point_box >= 0, len(found) + old.point_box, -1)
    for number, candidate in enumerate(found):
        claimed[candidate.members] = number
    return candidates.select(kept), target[claimed].astype(np.int64), int((~kept).sum())
