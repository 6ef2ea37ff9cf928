"""Synthetic streets as a Semantic3D data set: one dense terrestrial scan a station, .txt and .labels."""

from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Int

from rm3d_plugin.datasets.semantic3d import HOLDOUT, TRAINING
from rm3d_plugin.datasets.semantic3d_format import GREATEST, LEAST
from rm3d_plugin.datasets.synthetic.lidar import SpinningLidar
from rm3d_plugin.datasets.synthetic.parts import Part, paint
from rm3d_plugin.datasets.synthetic.room_demo import fill_demo
from rm3d_plugin.datasets.synthetic.street_scans import (
    STREETS_VERSION,
    VAL_STREETS,
    check_counts,
    generator,
    make_scene,
    pose_on_road,
    scan_scene,
)
from rm3d_plugin.storage import write_bytes

README = """This folder is SYNTHETIC. rm3d_plugin made it: parametric streets, scanned by a virtual terrestrial scanner.
The files have the format and the names of Semantic3D, but none of the content comes from it, and a score on them says
nothing about real data. demo.json holds the parameters; delete the folder to make it afresh.
"""
TOP, BOTTOM = 50.0, -60.0  # degrees, elevations that the scanner reaches
# Semantic3D's ids; triangles without a kind of their own are hard scape, people are unlabelled as moving things are.
LABELS = {
    Part.OBJECT: 6, Part.ROAD: 1, Part.PARKING: 1, Part.SIDEWALK: 1, Part.TERRAIN: 2, Part.BUILDING: 5, Part.WALL: 6,
    Part.FENCE: 6, Part.VEGETATION: 4, Part.CROWN: 3, Part.TRUNK: 3, Part.POLE: 6, Part.SIGN: 6, Part.TRAFFIC_LIGHT: 6,
    Part.GUARDRAIL: 6, Part.CAR: 8, Part.VAN: 8, Part.TRUCK: 8, Part.TRAILER: 8, Part.BICYCLE: 6, Part.MOTORCYCLE: 8,
    Part.PERSON: 7, Part.BICYCLIST: 7, Part.MOTORCYCLIST: 7,
}  # fmt: skip
UNSURE = 0.02  # share of points that are left unlabelled


def make_semantic3d_streets(
    root: Path | str,
    num_train: int = 12,
    num_val: int = 3,
    seed: int = 0,
    step: float = 0.35,
    workers: int = 1,
    progress: bool = True,
) -> Path:
    """Make a synthetic Semantic3D data set, or leave it as it is where it is complete and of these parameters.

    Stations bear the names of the benchmark's training stations; those held out are the ones the reader holds out.

    Args:
        root: Folder to fill; a folder that holds anything else is refused.
        num_train: Training stations, 12 at most.
        num_val: Stations to measure on, 3 at most.
        seed: Another seed makes other streets.
        step: Degrees between two points, along and across. Larger: fewer points, faster.
        workers: Processes; the result does not depend on it.
        progress: Show a bar.

    Returns:
        The root as a path.

    Raises:
        ValueError: The folder holds files that this function did not make, or a number is out of range.
    """
    root = Path(root)
    check_counts(num_train=num_train, num_val=num_val)
    train, val = [name for name in TRAINING if name not in HOLDOUT], list(HOLDOUT)
    if num_train > len(train) or num_val > len(val):
        raise ValueError(
            f'expected at most num_train={len(train)} and num_val={len(val)} stations, got {num_train} and {num_val}'
        )
    scanner = make_scanner(step)
    numbered = [*enumerate(train[:num_train]), *enumerate(val[:num_val], start=VAL_STREETS)]
    todo = [(root / name, partial(_write_station, seed, number, name, scanner)) for number, name in numbered]
    recipe = {
        'format': 'semantic3d',
        'version': STREETS_VERSION,
        'synthetic': True,
        'seed': seed,
        'step': step,
        'num_train': num_train,
        'num_val': num_val,
    }
    return fill_demo(root, recipe, {}, TRAINING, README, todo, _nothing, workers, progress, 'synthetic stations')


def make_scanner(step: float) -> SpinningLidar:
    """A terrestrial scanner: as dense upwards as around, precise, blind above 50 degrees."""
    tilts = tuple(round(TOP - i * step, 6) for i in range(int((TOP - BOTTOM) / step + 1e-9) + 1))
    return SpinningLidar(
        step, max_range=70.0, range_noise=0.006, lost=0.02, mixed=0.05, laser_spread=0.0, hidden=0.0, tilts=tilts
    )


def make_station(seed: int, number: int, scanner: SpinningLidar) -> tuple[Int[np.ndarray, 'points 7'], np.ndarray]:
    """Rows x, y, z in millimetres, raw intensity and colour, and the labels; depends on nothing but the arguments."""
    scene, rng = make_scene(seed, number), generator(seed, number, 2)
    scan = scan_scene(scene, pose_on_road(scene.road, 12.0 * rng.random()), scanner, rng)
    raw = np.round(LEAST + (GREATEST - LEAST) * scan.intensity)
    table = np.zeros(len(Part), dtype=np.int64)
    for part, label in LABELS.items():
        table[part] = label
    labels = np.where(rng.random(len(scan.part)) < UNSURE, 0, table[scan.part])
    colors = paint(scan.part, scan.thing, rng)
    millimetres = np.round(scan.xyz * 1000.0)
    return np.concatenate([millimetres, raw[:, None], colors], axis=1).astype(np.int64), labels


def _write_station(seed: int, number: int, name: str, scanner: SpinningLidar, folder: Path) -> None:
    rows, labels = make_station(seed, number, scanner)
    stem = f'{name}_intensity_rgb' if name.startswith('sg') else f'{name}_xyz_intensity_rgb'
    lines = [
        f'{x / 1000:.3f} {y / 1000:.3f} {z / 1000:.3f} {intensity} {red} {green} {blue}\n'
        for x, y, z, intensity, red, green, blue in rows.tolist()
    ]
    write_bytes(folder / f'{stem}.txt', ''.join(lines).encode('ascii'))
    write_bytes(folder / f'{stem}.labels', ''.join(f'{label}\n' for label in labels.tolist()).encode('ascii'))


def _nothing() -> None:
    """There are no lists to write."""
