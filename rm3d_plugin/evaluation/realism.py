"""Whether made-up scans are like real ones: statistics of both, side by side.

``python -m rm3d_plugin.evaluation.realism rooms`` (or ``streets``) prints the table.
"""

import argparse
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from rm3d_plugin.datasets.scannet_format import class_of_nyu40
from rm3d_plugin.datasets.synthetic.lidar import SpinningLidar
from rm3d_plugin.datasets.synthetic.rooms import SPACING, RoomScan, make_room
from rm3d_plugin.datasets.synthetic.semantickitti_writer import make_scan, raw_labels
from rm3d_plugin.evaluation.functional.scan_statistics import room_statistics
from rm3d_plugin.evaluation.functional.street_statistics import street_statistics

ROOM_POINTS = 50_000  # of a room; statistics of more points are of a finer scale
STUFF = 2  # ScanNet's first classes, wall and floor, have no instances


class Range(NamedTuple):
    """A quantity over several scans."""

    median: float
    lowest: float
    highest: float

    def holds(self, value: float) -> bool:
        """Whether a value lies between the lowest and the highest."""
        return self.lowest <= value <= self.highest


# Eleven real rooms, scanned by hand with a depth camera and fused into meshes; 50 thousand points of each.
REAL_ROOMS: dict[str, Range] = {
    'spacing_cm': Range(1.6, 1.4, 3.3),
    'extent_m': Range(6.7, 4.5, 10.7),
    'noise_mm': Range(2.1, 0.8, 6.1),
    'curvature_p50': Range(0.0173, 0.0039, 0.0658),
    'curvature_p90': Range(0.136, 0.081, 0.174),
    'step_inside_deg': Range(4.3, 2.2, 8.5),
    'step_across_deg': Range(21.0, 14.0, 25.0),
    'unannotated_pct': Range(18.9, 7.5, 43.4),
    'pairs_across_pct': Range(2.6, 1.3, 6.4),
    'near_border_pct': Range(7.8, 3.5, 10.5),
    'auc_normal': Range(0.78, 0.63, 0.88),
    'auc_curvature': Range(0.73, 0.60, 0.82),
    'auc_color': Range(0.67, 0.61, 0.77),
    'color_spread': Range(20.0, 16.0, 25.0),
}
# Six real scans of SemanticKITTI, measured by the functions that the made-up ones are measured by. Three of them hold
# no intensities, which is why spreads begin at 0 and areas under curves at 0.5.
REAL_STREETS: dict[str, Range] = {
    'unlabelled_pct': Range(3.08, 1.75, 8.60),
    'range_m': Range(11.0, 9.0, 17.1),
    'road_rough_mm': Range(3.77, 2.74, 4.30),
    'kerb_cm': Range(4.15, 2.18, 7.82),
    'spread_road': Range(0.0546, 0.0, 0.114),
    'spread_building': Range(0.140, 0.0, 0.148),
    'spread_vegetation': Range(0.0545, 0.0, 0.114),
    'spread_car': Range(0.0899, 0.0, 0.199),
    'auc_road_pavement': Range(0.745, 0.5, 0.753),
    'auc_road_terrain': Range(0.637, 0.5, 0.851),
    'auc_pavement_terrain': Range(0.547, 0.5, 0.674),
    'auc_road_parking': Range(0.763, 0.755, 0.772),
    'auc_building_vegetation': Range(0.675, 0.5, 0.714),
    'auc_vegetation_trunk': Range(0.531, 0.5, 0.683),
    'auc_vegetation_fence': Range(0.606, 0.5, 0.678),
    'auc_pole_trunk': Range(0.686, 0.5, 0.785),
    'share_car_pct': Range(2.66, 0.355, 7.90),
    'share_trunk_pct': Range(0.572, 0.0, 3.72),
    'share_pole_pct': Range(0.568, 0.403, 0.685),
    'share_vegetation_pct': Range(20.0, 18.1, 33.8),
    'share_building_pct': Range(15.0, 0.0, 21.2),
    'share_terrain_pct': Range(9.07, 0.347, 39.4),
    'car_points': Range(1003.0, 103.0, 3933.0),
}


def summary(rows: Sequence[dict[str, float]]) -> dict[str, Range]:
    """Median, lowest and highest of each quantity; NaN counts as not measured."""
    out = {}
    for key in rows[0]:
        column = np.array([row[key] for row in rows])
        column = column[np.isfinite(column)]
        if len(column):
            out[key] = Range(float(np.median(column)), float(column.min()), float(column.max()))
    return out


def measure_room(room: RoomScan) -> dict[str, float]:
    """Statistics of a made-up room as ScanNet's twenty classes see it."""
    semantic = class_of_nyu40(room.nyu40)
    instance = np.where(semantic >= STUFF, room.instance, -1)
    order = np.random.Generator(np.random.PCG64(0)).permutation(len(room))[:ROOM_POINTS]
    xyz, rgb = room.aligned[order], room.colors[order] / 255.0
    return room_statistics(xyz, rgb, semantic[order], instance[order])._asdict()


def measure_street(seed: int, number: int, lidar: SpinningLidar) -> dict[str, float]:
    """Statistics of a made-up street as SemanticKITTI's labels see it."""
    scan, _ = make_scan(seed, number, 0, lidar)
    raw, instance = raw_labels(scan)
    return street_statistics(scan.xyz, scan.intensity, raw, instance)


def table(measured: dict[str, Range], real: dict[str, Range]) -> Iterable[str]:
    """Lines of a table, real beside synthetic."""
    yield f'{"quantity":28s} {"real":>30s} {"synthetic":>30s}'
    for key, made in measured.items():
        there = real.get(key)
        told = '-' if there is None else _told(there)
        note = '' if there is None or there.holds(made.median) else '  outside'
        yield f'{key:28s} {told:>30s} {_told(made):>30s}{note}'


def _told(values: Range) -> str:
    return f'{values.median:.3g} ({values.lowest:.3g} to {values.highest:.3g})'


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the statistics of made-up scans beside those of real ones."""
    parser = argparse.ArgumentParser(prog='python -m rm3d_plugin.evaluation.realism', description=main.__doc__)
    parser.add_argument('kind', choices=('rooms', 'streets'))
    parser.add_argument('--scans', type=int, default=12, help='how many; a room takes a second or two')
    parser.add_argument('--seed', type=int, default=0, help='another seed makes other scans')
    parser.add_argument('--spacing', type=float, default=SPACING, help='of rooms, metres')
    given = parser.parse_args(arguments)
    if given.kind == 'rooms':
        rows = [measure_room(make_room(given.seed, n, given.spacing)) for n in range(given.scans)]
    else:
        rows = [measure_street(given.seed, n, SpinningLidar()) for n in range(given.scans)]
    real = REAL_ROOMS if given.kind == 'rooms' else REAL_STREETS
    print('\n'.join(table(summary(rows), real)))


if __name__ == '__main__':
    main()
