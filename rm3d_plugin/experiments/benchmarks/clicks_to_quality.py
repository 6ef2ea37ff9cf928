"""How many clicks it takes on scans that are named, a line a run; ``rm3d reproduce clicks-to-quality`` is the table."""

import argparse
import sys
from typing import Any

import numpy as np

from rm3d_plugin.experiments.benchmarks.measure import machine
from rm3d_plugin.experiments.benchmarks.propagate_clicks import add_scan_arguments, scans_asked
from rm3d_plugin.experiments.click_curves import clicks_to, curves_of
from rm3d_plugin.experiments.next_click import SCORES

NAME = 'clicks-to-quality'
HELP = 'share of points that are right after each click, by how the next click is chosen'
AT = (5, 10, 20, 30, 60, 100, 150, 200)  # clicks whose shares are printed
GOALS = (70, 80, 90)  # percent right


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the benchmark."""
    add_scan_arguments(parser)
    parser.add_argument('--clicks', type=int, default=30, help='of each run; default 30')
    parser.add_argument('--scores', nargs='+', choices=SCORES, default=list(SCORES), help='default: all')
    parser.set_defaults(repeats=1)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """A line a scan, score and seed on the way; then means."""
    curves: dict[str, dict[str, list[list[float]]]] = {}
    for scan in scans_asked(args):
        for curve in curves_of(scan, args.scores, args.seeds, args.clicks):
            own = curves.setdefault(f'{curve.score}, {curve.labels}', {})
            own.setdefault(curve.scan, []).append(curve.right)
            text = ' '.join(f'{at}:{curve.right[at - 1]:.1f}' for at in AT if at <= args.clicks)
            text += '; ' + ', '.join(f'{goal} %: {clicks_to(goal, np.array([curve.right]))[0]:.0f}' for goal in GOALS)
            name = f'{curve.scan:16s} {curve.score:8s} {curve.labels:14s}'
            print(f'{name} seed {curve.seed}  {text}', file=sys.stderr, flush=True)
    return {name: summary(np.array(list(own.values()))) for name, own in curves.items()} | {'machine': machine()}


def summary(by_scan: np.ndarray) -> dict[str, Any]:
    """Mean curve, and clicks to each goal, median and mean; a run of N clicks that misses it counts as N + 1.

    Args:
        by_scan: (scans, seeds, clicks) percent right.
    """
    count = by_scan.shape[2]
    curves = by_scan.reshape(-1, count)
    out: dict[str, Any] = {
        f'right after {at}, %': round(float(curves[:, at - 1].mean()), 1) for at in AT if at <= count
    }
    for goal in GOALS:
        reached = clicks_to(goal, curves)
        median = float(np.median(reached))
        out[f'clicks to {goal} %'] = f'over {count}' if median > count else median
        out[f'clicks to {goal} %, mean'] = round(float(reached.mean()), 1)
        own = [np.median(clicks_to(goal, scan)) for scan in by_scan]
        out[f"clicks to {goal} %, mean of the scans' medians"] = round(float(np.mean(own)), 1)
    return out
