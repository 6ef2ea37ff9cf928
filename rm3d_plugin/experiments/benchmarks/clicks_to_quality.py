"""How many clicks it takes: a made-up annotator who clicks where each score tells, on scans whose classes are known.

Each click shows the true class of one point; the labels are spread after each, and the share of points that are right
is noted. Scores: chance; ours; the entropy of a region's mean label; the mixture of named classes in it (Annotator,
Xie et al. 2023). Labels are also spread by the nearest click, for the clicks of chance.
"""

import argparse
import sys
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from rm3d_plugin.annotation.suggestions import Suggester
from rm3d_plugin.experiments.benchmarks.measure import machine
from rm3d_plugin.experiments.benchmarks.propagate_clicks import Scan, add_scan_arguments, scans_asked
from rm3d_plugin.pseudo_labels.propagation.live import LiveAnswer, LivePropagation
from rm3d_plugin.pseudo_labels.propagation.nearest import nearest_label
from rm3d_plugin.pseudo_labels.propagation.prepared import prepare_cloud

NAME = 'clicks-to-quality'
HELP = 'share of points that are right after each click, by how the next click is chosen'
SCORES = ('chance', 'ours', 'entropy', 'mixture')
NEAREST = 'chance, nearest click'
AT = (5, 10, 20, 30)  # clicks whose shares are printed
GOALS = (70, 80, 90)  # percent right
Next = Callable[[LiveAnswer, np.ndarray, set[int]], int | None]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the benchmark."""
    add_scan_arguments(parser)
    parser.add_argument('--clicks', type=int, default=30, help='of each run; default 30')
    parser.add_argument('--scores', nargs='+', choices=SCORES, default=list(SCORES), help='default: all')
    parser.set_defaults(repeats=1)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """A line a scan, score and seed on the way; then means."""
    curves: dict[str, list[list[float]]] = {}
    for scan in scans_asked(args):
        for name, seed, curve in curves_of(scan, args.scores, args.seeds, args.clicks):
            curves.setdefault(name, []).append(curve)
            text = ' '.join(f'{at}:{curve[at - 1]:.1f}' for at in AT if at <= args.clicks)
            print(f'{scan.name:16s} {name:22s} seed {seed}  {text}', file=sys.stderr, flush=True)
    return {name: summary(np.array(own)) for name, own in curves.items()} | {'machine': machine()}


def curves_of(scan: Scan, scores: list[str], seeds: list[int], clicks: int) -> Iterator[tuple[str, int, list[float]]]:
    """Score, seed and the percent of the points with a known class that are right after each click."""
    live = LivePropagation(prepare_cloud(scan.cloud))
    suggester = Suggester(live)
    for seed in seeds:
        for name in scores:
            clicked = clicked_points(scan, live, choose_by(name, scan, live, suggester, seed), clicks, seed)
            yield name, seed, [live_right(scan, live, clicked[: count + 1]) for count in range(len(clicked))]
            if name == 'chance':
                yield NEAREST, seed, [nearest_right(scan, clicked[: count + 1]) for count in range(len(clicked))]


def clicked_points(scan: Scan, live: LivePropagation, choose: Next, clicks: int, seed: int) -> np.ndarray:
    """Points in the order they are clicked; the first is where most of the scan is alike, or by chance."""
    out, seen = list[int](), set[int]()
    classes = int(scan.semantic.max()) + 1
    while len(out) < clicks:
        points = np.array(out, dtype=np.int64)
        order = np.argsort(points)
        answer = live.answer(points[order], scan.semantic[points[order]], classes)
        point = choose(answer, points, seen)
        if point is None:  # no place is left: anywhere
            rest = np.setdiff1d(np.flatnonzero(scan.semantic >= 0), points)
            point = int(np.random.default_rng([seed, len(out)]).choice(rest))
        seen.add(point)
        if scan.semantic[point] >= 0:  # the annotator passes over what has no class
            out.append(point)
    return np.array(out, dtype=np.int64)


def choose_by(name: str, scan: Scan, live: LivePropagation, suggester: Suggester, seed: int) -> Next:
    """How the next point is chosen."""
    generator = np.random.default_rng(seed)
    asked = np.flatnonzero(scan.semantic >= 0)
    regions = live.scene.scales[-1]
    middle = suggester.points

    def chance(answer: LiveAnswer, points: np.ndarray, seen: set[int]) -> int | None:
        return int(generator.choice(np.setdiff1d(asked, points)))

    def ours(answer: LiveAnswer, points: np.ndarray, seen: set[int]) -> int | None:
        if seed and not len(points):  # another beginning
            return chance(answer, points, seen)
        found = suggester.suggest(answer, points, scan.semantic[points], seen)
        return found[0].point if found else None

    def uncertain(answer: LiveAnswer, points: np.ndarray, seen: set[int]) -> int | None:
        if not len(points):
            return chance(answer, points, seen)
        shares = answer.shares if name == 'entropy' else np.eye(answer.shares.shape[1])[answer.shares.argmax(axis=1)]
        mean = regions.mean(shares)[suggester.regions]
        score = -(mean * np.log(np.maximum(mean, 1e-9))).sum(axis=1)
        score[np.isin(middle, [*seen, *points.tolist()])] = -1.0
        return int(middle[score.argmax()]) if score.max() >= 0 else None

    return {'chance': chance, 'ours': ours}.get(name, uncertain)


def live_right(scan: Scan, live: LivePropagation, points: np.ndarray) -> float:
    """Percent right by our propagation."""
    points = np.sort(points)
    answer = live.answer(points, scan.semantic[points], int(scan.semantic.max()) + 1)
    return _right(answer.shares.argmax(axis=1), scan.semantic)


def nearest_right(scan: Scan, points: np.ndarray) -> float:
    """Percent right by the nearest click."""
    return _right(scan.semantic[points][nearest_label(scan.cloud.xyz, points, np.arange(len(points)))], scan.semantic)


def _right(said: np.ndarray, semantic: np.ndarray) -> float:
    known = semantic >= 0
    return 100.0 * float((said[known] == semantic[known]).mean())


def summary(curves: np.ndarray) -> dict[str, Any]:
    """Mean curve, and clicks to each goal, median and mean; a run of N clicks that misses it counts as N + 1."""
    count = curves.shape[1]
    out: dict[str, Any] = {
        f'right after {at}, %': round(float(curves[:, at - 1].mean()), 1) for at in AT if at <= count
    }
    for goal in GOALS:
        reached = np.where((curves >= goal).any(axis=1), (curves >= goal).argmax(axis=1) + 1, count + 1)
        median = float(np.median(reached))
        out[f'clicks to {goal} %'] = f'over {count}' if median > count else median
        out[f'clicks to {goal} %, mean'] = round(float(reached.mean()), 1)
    return out
