"""Synthetic streets as a vKITTI 3D data set: folds 01 to 06 of .npy frames, x y z r g b label."""

from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float

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

README = """This folder is SYNTHETIC. rm3d_plugin made it: parametric streets, scanned by a virtual depth sensor.
The files have the format of vKITTI 3D, but none of the content comes from it, and a score on them says nothing about
that data set. demo.json holds the parameters; delete the folder to make it afresh.
"""
TRAIN_FOLDS, VAL_FOLD = 5, 6
HALF_VIEW = 0.62  # tangent of half the camera's horizontal field of view
# terrain, tree, vegetation, building, road, guardrail, trafficsign, trafficlight, pole, misc, truck, car, van;
# there are no people in it, so what has no class is "misc".
LABELS = {
    Part.OBJECT: 9, Part.ROAD: 4, Part.PARKING: 4, Part.SIDEWALK: 0, Part.TERRAIN: 0, Part.BUILDING: 3, Part.WALL: 9,
    Part.FENCE: 9, Part.VEGETATION: 2, Part.CROWN: 1, Part.TRUNK: 1, Part.POLE: 8, Part.SIGN: 6, Part.TRAFFIC_LIGHT: 7,
    Part.GUARDRAIL: 5, Part.CAR: 11, Part.VAN: 12, Part.TRUCK: 10, Part.TRAILER: 10, Part.BICYCLE: 9,
    Part.MOTORCYCLE: 9, Part.PERSON: 9, Part.BICYCLIST: 9, Part.MOTORCYCLIST: 9,
}  # fmt: skip


def make_vkitti_streets(
    root: Path | str,
    num_train: int = 75,
    num_val: int = 15,
    seed: int = 0,
    step: float = 0.25,
    workers: int = 1,
    progress: bool = True,
) -> Path:
    """Make a synthetic vKITTI 3D data set, or leave it as it is where it is complete and of these parameters.

    Training frames go round the folds 1 to 5; the others are fold 6.

    Args:
        root: Folder to fill; a folder that holds anything else is refused.
        num_train: Frames of folds 1 to 5.
        num_val: Frames of fold 6.
        seed: Another seed makes other streets.
        step: Degrees between two points. Larger: fewer points, faster.
        workers: Processes; the result does not depend on it.
        progress: Show a bar.

    Returns:
        The root as a path.

    Raises:
        ValueError: The folder holds files that this function did not make, or a number is out of range.
    """
    root = Path(root)
    check_counts(num_train=num_train, num_val=num_val)
    folds = {f'{fold + 1:02d}': tuple(range(fold, num_train, TRAIN_FOLDS)) for fold in range(TRAIN_FOLDS)}
    folds[f'{VAL_FOLD:02d}'] = tuple(range(VAL_STREETS, VAL_STREETS + num_val))
    sensor = make_sensor(step)
    todo = [(root / name, partial(_write_fold, seed, numbers, sensor)) for name, numbers in folds.items() if numbers]
    recipe = {
        'format': 'vkitti',
        'version': STREETS_VERSION,
        'synthetic': True,
        'seed': seed,
        'step': step,
        'num_train': num_train,
        'num_val': num_val,
    }
    return fill_demo(root, recipe, {}, tuple(folds), README, todo, _nothing, workers, progress, 'synthetic folds')


def make_sensor(step: float) -> SpinningLidar:
    """A depth camera's rows, almost without noise; what lies beside its view is dropped later."""
    tilts = tuple(round(10.0 - i * step, 6) for i in range(int(26.0 / step + 1e-9) + 1))
    return SpinningLidar(
        step, max_range=70.0, range_noise=0.002, lost=0.0, mixed=0.0, laser_spread=0.0, hidden=0.0, tilts=tilts
    )


def make_frame(seed: int, number: int, sensor: SpinningLidar) -> Float[np.ndarray, 'points 7']:
    """Rows x, y, z (metres; forward, left, up), r, g, b (0 to 255), label; depends on nothing but the arguments."""
    scene, rng = make_scene(seed, number), generator(seed, number, 2)
    scan = scan_scene(scene, pose_on_road(scene.road, 0.0), sensor, rng)
    colors = paint(scan.part, scan.thing, rng, grain=6.0)
    table = np.zeros(len(Part), dtype=np.int64)
    for part, label in LABELS.items():
        table[part] = label
    rows = np.concatenate([scan.xyz, colors, table[scan.part][:, None]], axis=1)
    return rows[np.abs(scan.xyz[:, 1]) < HALF_VIEW * scan.xyz[:, 0]]


def _write_fold(seed: int, numbers: tuple[int, ...], sensor: SpinningLidar, folder: Path) -> None:
    for count, number in enumerate(numbers):
        path = folder / f'0001_{count:05d}.npy'
        np.save(path, make_frame(seed, number, sensor).astype('<f4'), allow_pickle=False)


def _nothing() -> None:
    """There are no lists to write."""
