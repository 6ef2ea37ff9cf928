"""How right a scan is after each click of a made-up annotator who never errs."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.experiments.benchmarks.propagate_clicks import Scan
from rm3d_plugin.experiments.next_click import ClickChooser, Next
from rm3d_plugin.pseudo_labels.propagation.live import LivePropagation
from rm3d_plugin.pseudo_labels.propagation.prepared import prepare_cloud

NEAREST, OURS = 'nearest click', 'ours'  # how labels spread
BOUND = 'commonest classes', 'whole classes'  # no way of clicking and spreading is better: a click names one class


class Curve(NamedTuple):
    """One run of the annotator.

    Attributes:
        scan: Name.
        score: By which the next click was chosen.
        labels: How they spread: :data:`NEAREST` or :data:`OURS`; :data:`BOUND` is the most that is possible.
        seed: Of what is by chance.
        right: Percent of the points with a class that are right after each click.
    """

    scan: str
    score: str
    labels: str
    seed: int
    right: list[float]


def curves_of(scan: Scan, scores: Sequence[str], seeds: Sequence[int], clicks: int) -> Iterator[Curve]:
    """Curves of a scan; labels spread by ours and by the nearest click, which is chosen for by ours, too; the bound.

    Args:
        scan: With its classes.
        scores: Of :data:`~rm3d_plugin.experiments.next_click.SCORES`.
        seeds: A run each.
        clicks: Of each run.
    """
    live = LivePropagation(prepare_cloud(scan.cloud))
    chooser = ClickChooser(live, scan.semantic)
    for seed in seeds:
        yield Curve(scan.name, *BOUND, seed, most_right(scan.semantic, clicks))
        for name in scores:
            points, right = _clicked(scan, live, chooser.by(name, seed), clicks, seed)
            yield Curve(scan.name, name, OURS, seed, right)
            yield Curve(scan.name, name, NEAREST, seed, nearest_right(scan, points))


def _clicked(
    scan: Scan, live: LivePropagation, choose: Next, clicks: int, seed: int
) -> tuple[Int[np.ndarray, ' clicked'], list[float]]:
    """Points in the order they are clicked, and percent right after each."""
    out, right, seen, classes = list[int](), list[float](), set[int](), int(scan.semantic.max()) + 1
    clicked = np.zeros(0, dtype=np.int64)
    answer = live.answer(clicked, clicked, classes)
    while len(out) < clicks:
        point = choose(answer, clicked, seen)
        if point is None:  # no place is left: anywhere
            rest = np.setdiff1d(np.flatnonzero(scan.semantic >= 0), clicked)
            point = int(np.random.default_rng([seed, len(out)]).choice(rest))
        seen.add(point)
        if scan.semantic[point] < 0:  # the annotator passes over what has no class
            continue
        out.append(point)
        clicked = np.array(out, dtype=np.int64)
        order = np.sort(clicked)
        answer = live.answer(order, scan.semantic[order], classes)
        right.append(percent_right(answer.shares.argmax(axis=1), scan.semantic))
    return clicked, right


def nearest_right(scan: Scan, points: Int[np.ndarray, ' clicked']) -> list[float]:
    """Percent right after each click where each point is called as the nearest click so far."""
    xyz = scan.cloud.xyz.astype(np.float64)
    least, said, right = np.full(len(xyz), np.inf), np.zeros(len(xyz), dtype=np.int64), list[float]()
    for point in points.tolist():
        away = np.square(xyz - xyz[point]).sum(axis=1)
        nearer = away < least
        least[nearer], said[nearer] = away[nearer], scan.semantic[point]
        right.append(percent_right(said, scan.semantic))
    return right


def most_right(semantic: Int[np.ndarray, ' points'], clicks: int) -> list[float]:
    """The most percent that can be right after each click: all points of as many classes, the commonest first.

    >>> most_right(np.array([0, 1, 1, 2, 1, -1]), 4)
    [60.0, 80.0, 100.0, 100.0]
    """
    sizes = np.sort(np.bincount(semantic[semantic >= 0]))[::-1]
    reached = np.minimum(np.arange(clicks), len(sizes) - 1)
    return (100.0 * np.cumsum(sizes) / sizes.sum())[reached].tolist()


def percent_right(said: Int[np.ndarray, ' points'], semantic: Int[np.ndarray, ' points']) -> float:
    """Of the points with a class."""
    known = semantic >= 0
    return 100.0 * float((said[known] == semantic[known]).mean())


def clicks_to(goal: float, right: Float[np.ndarray, 'runs clicks']) -> Float[np.ndarray, ' runs']:
    """Clicks until a percentage is reached; a run of N clicks that misses it counts as N + 1.

    >>> clicks_to(80, np.array([[50.0, 81.0, 79.0], [10.0, 20.0, 30.0]])).tolist()
    [2.0, 4.0]
    """
    reached = right >= goal
    return np.where(reached.any(axis=1), reached.argmax(axis=1) + 1.0, right.shape[1] + 1.0)
