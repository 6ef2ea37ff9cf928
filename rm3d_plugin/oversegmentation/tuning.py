"""Settings of an over-segmenter from the annotated labels alone: least conflicts at a target count (METHOD 5)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int

from rm3d_plugin.oversegmentation.region_growing import RegionGrowing
from rm3d_plugin.structures import Descriptors, PointCloud

ZETAS = (0.005, 0.015, 0.04)  # curvature differences: half, one and two to three times the presets'
THETAS = (3.0, 60.0)  # degrees; 60 is the paper's, below 3 estimated normals of one plane differ by more
STEPS = 6  # halvings of the angle's range (of its logarithm): 60 / 3 becomes a factor of 1.05
SLACK = 1.25  # region counts within this factor of the target are at the target


class Score(NamedTuple):
    """A partition against annotated labels; scenes are added up.

    Attributes:
        regions: How many.
        conflicts: Labelled points whose region holds more labelled points of another class.
        labelled: Labelled points that lie in a region.
    """

    regions: int
    conflicts: int
    labelled: int


class Trial(NamedTuple):
    """Settings that were tried, and what came of them."""

    options: dict[str, float]
    score: Score


@dataclass(frozen=True)
class Tuning:
    """The best settings, and all that were tried.

    Attributes:
        options: Arguments of the over-segmenter that were tuned.
        score: What they score on the scenes of the tuning.
        target: Regions wanted in all of these scenes together.
        trials: In the order in which they were tried.
    """

    options: dict[str, float]
    score: Score
    target: int
    trials: tuple[Trial, ...]


def score_regions(regions: Int[np.ndarray, ' points'], annotated_labels: Int[np.ndarray, ' points']) -> Score:
    """Count the regions of one scene, and the labels that disagree with most others of their region.

    Points are counted, not regions: a scene that has run together into one region would have a single conflict.

    Args:
        regions: Region of each point, -1 = discarded; what is labelled there is not counted.
        annotated_labels: Class of each labelled point, -1 = not labelled.

    Raises:
        ValueError: The lengths differ.
    """
    if len(regions) != len(annotated_labels):
        raise ValueError(f'score_regions: {len(regions)} points, but {len(annotated_labels)} annotated labels')
    kept = (regions >= 0) & (annotated_labels >= 0)
    pairs, counts = np.unique(np.stack([regions[kept], annotated_labels[kept]]), axis=1, return_counts=True)
    _, first = np.unique(pairs[0], return_index=True)
    agreeing = np.maximum.reduceat(counts, first).sum() if len(first) else 0
    number = len(np.unique(regions[regions >= 0]))
    return Score(number, int(kept.sum() - agreeing), int(kept.sum()))


def bisect_count(
    regions_at: Callable[[float], int], low: float, high: float, target: int, steps: int = STEPS
) -> list[float]:
    """Values tried on the way to one that gives ``target`` regions; regions become fewer as the value grows.

    Args:
        regions_at: Regions at a value.
        low: Least value, positive: most regions.
        high: Greatest value.
        target: Regions wanted.
        steps: Halvings; one value each.
    """
    tried = []
    for _ in range(steps):
        middle = float(np.sqrt(low * high))
        tried.append(middle)
        count = regions_at(middle)
        if count == target:
            break
        low, high = (middle, high) if count > target else (low, middle)
    return tried


def choose_trial(trials: Sequence[Trial], target: int, slack: float = SLACK) -> Trial:
    """The trial with the least share of conflicts among those at the target number of regions.

    Where none is within the factor ``slack`` of the target, those count that come nearest. Ties: the nearest to the
    target, then the first.

    Raises:
        ValueError: Nothing was tried.
    """
    if not trials:
        raise ValueError('choose_trial: nothing was tried')
    away = [abs(np.log(max(trial.score.regions, 1) / target)) for trial in trials]
    limit = max(np.log(slack), min(away)) + 1e-12
    shares = [trial.score.conflicts / max(trial.score.labelled, 1) for trial in trials]
    best = min((shares[i], away[i], i) for i in range(len(trials)) if away[i] <= limit)
    return trials[best[-1]]


def tune_options(
    score_of: Callable[[Mapping[str, float]], Score],
    name: str,
    span: tuple[float, float],
    target: int,
    others: Sequence[Mapping[str, float]] = ({},),
    steps: int = STEPS,
    slack: float = SLACK,
) -> Tuning:
    """Find the option that gives a number of regions, for each choice of the others; the least conflicts win.

    Args:
        score_of: Scores a choice of options.
        name: Option that makes regions fewer as it grows.
        span: Its least and greatest value, positive.
        target: Regions wanted in all scenes together.
        others: Choices of further options, each tried with values of its own.
        steps: Values for each of these.
        slack: See :func:`choose_trial`.

    Raises:
        ValueError: A number is out of range.
    """
    if target < 1 or steps < 1 or not 0 < span[0] <= span[1] or not slack >= 1:
        raise ValueError(
            'tune_options: expected target >= 1, steps >= 1, 0 < least <= greatest, slack >= 1, '
            f'got {target}, {steps}, {span}, {slack}'
        )
    trials: list[Trial] = []
    for fixed in others:

        def regions_at(value: float, fixed: Mapping[str, float] = fixed) -> int:
            options = {**fixed, name: value}
            trials.append(Trial(options, score_of(options)))
            return trials[-1].score.regions

        bisect_count(regions_at, *span, target, steps)
    best = choose_trial(trials, target, slack)
    return Tuning(best.options, best.score, target, tuple(trials))


def tune_region_growing(
    clouds: Sequence[PointCloud],
    descriptors: Sequence[Descriptors],
    annotated_labels: Sequence[Int[np.ndarray, ' _points']],
    target_regions: int,
    base: Mapping[str, Any] | None = None,
    zetas: Sequence[float] = ZETAS,
    thetas: tuple[float, float] = THETAS,
    steps: int = STEPS,
    slack: float = SLACK,
) -> Tuning:
    """Theta and zeta of region growing from annotated labels alone: least conflicts at a target count (METHOD 5).

    For each zeta the angle theta is halved down to the target; ``len(zetas) * steps`` partitions a scene. Labels do
    not seed the growing here, so that they can tell where it goes wrong. The same input gives the same result.

    Args:
        clouds: Scenes; give them normals and curvature, or every partition estimates them anew.
        descriptors: Of each scene, one row a point.
        annotated_labels: Of each scene, class of each point, -1 = not labelled.
        target_regions: Regions wanted in all scenes together.
        base: Further arguments of :class:`RegionGrowing`; ground is taken off where they say so.
        zetas: Choices of zeta (Condition 2).
        thetas: Least and greatest theta, degrees (Condition 1).
        steps: Angles for each zeta (more: nearer to the target).
        slack: See :func:`choose_trial`.

    Returns:
        ``options`` holds ``theta`` and ``zeta`` for :class:`RegionGrowing`.

    Raises:
        ValueError: The scenes, descriptors and labels do not fit each other, no point is labelled, or a number is out
            of range.
    """
    if not len(clouds) == len(descriptors) == len(annotated_labels) or not len(clouds):
        raise ValueError(
            f'tune_region_growing: expected as many of each, at least one; got {len(clouds)} clouds, '
            f'{len(descriptors)} descriptors, {len(annotated_labels)} annotated labels'
        )
    if not any((np.asarray(labels) >= 0).any() for labels in annotated_labels):
        raise ValueError('tune_region_growing: no point is labelled, so no conflict can be seen; label some points')
    fixed = {name: value for name, value in (base or {}).items() if name not in ('threshold', 'theta', 'zeta')}
    ground = RegionGrowing(ground=fixed.pop('ground', None))
    scenes = [_above_ground(ground, *scene) for scene in zip(clouds, descriptors, annotated_labels, strict=True)]

    def score_of(options: Mapping[str, float]) -> Score:
        segmenter = RegionGrowing(**{**fixed, **options})
        scores = [score_regions(segmenter.partition(cloud, rows), labels) for cloud, rows, labels in scenes]
        return Score(*np.sum(scores, axis=0).tolist())

    return tune_options(
        score_of, 'theta', thetas, target_regions, [{'zeta': float(zeta)} for zeta in zetas], steps, slack
    )


def _above_ground(
    segmenter: RegionGrowing, cloud: PointCloud, descriptors: Descriptors, annotated_labels: Int[np.ndarray, ' points']
) -> tuple[PointCloud, Descriptors, Int[np.ndarray, ' kept']]:
    """One scene without its ground.

    Raises:
        ValueError: The lengths differ.
    """
    labels = np.asarray(annotated_labels)
    if not len(cloud) == len(descriptors) == len(labels):
        raise ValueError(
            f'tune_region_growing: a scene of {len(cloud)} points has {len(descriptors)} descriptors and '
            f'{len(labels)} annotated labels; expected one of each a point'
        )
    kept = np.flatnonzero(~segmenter.find_ground(cloud))
    return cloud.select(kept), descriptors.select(kept), labels[kept]
