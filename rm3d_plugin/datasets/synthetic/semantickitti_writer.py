"""Synthetic streets as a SemanticKITTI data set: sequences/NN/{velodyne,labels,calib.txt,poses.txt}."""

from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.datasets.kitti_format import invert_affine
from rm3d_plugin.datasets.semantickitti import TRAIN, VAL
from rm3d_plugin.datasets.semantickitti_format import pack_labels
from rm3d_plugin.datasets.synthetic.lidar import SpinningLidar
from rm3d_plugin.datasets.synthetic.parts import Part
from rm3d_plugin.datasets.synthetic.room_demo import fill_demo
from rm3d_plugin.datasets.synthetic.street_scans import (
    STREETS_VERSION,
    VAL_STREETS,
    LabelledScan,
    check_counts,
    generator,
    make_scene,
    pose_on_road,
    scan_scene,
)
from rm3d_plugin.storage import write_bytes

README = """This folder is SYNTHETIC. rm3d_plugin made it: parametric streets, scanned by a virtual lidar of 64 beams.
The files have the format of SemanticKITTI, but none of the content comes from it, and a score on them says nothing
about real data. demo.json holds the parameters; delete the folder to make it afresh.
"""
STEP = 1.0  # m between two scans of a street
LABELLED = 51.5  # m; beyond, real scans are not labelled
# Raw ids; walls and guard rails count as fences there, traffic lights, bins and the like as other objects.
RAW_IDS = {
    Part.OBJECT: 99, Part.ROAD: 40, Part.PARKING: 44, Part.SIDEWALK: 48, Part.TERRAIN: 72, Part.BUILDING: 50,
    Part.WALL: 51, Part.FENCE: 51, Part.VEGETATION: 70, Part.CROWN: 70, Part.TRUNK: 71, Part.POLE: 80, Part.SIGN: 81,
    Part.TRAFFIC_LIGHT: 99, Part.GUARDRAIL: 51, Part.CAR: 10, Part.VAN: 10, Part.TRUCK: 18, Part.TRAILER: 20,
    Part.BICYCLE: 11, Part.MOTORCYCLE: 15, Part.PERSON: 30, Part.BICYCLIST: 31, Part.MOTORCYCLIST: 32,
}  # fmt: skip
MOVING = {10: 252, 31: 253, 30: 254, 32: 255, 18: 258}
_THINGS = (10, 11, 15, 18, 20, 30, 31, 32)
# The camera looks along the lidar's x axis.
CAMERA_FROM_LIDAR = np.array([[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, -0.08], [1.0, 0.0, 0.0, -0.27], [0, 0, 0, 1]])


def make_semantickitti_streets(
    root: Path | str,
    num_train: int = 100,
    num_val: int = 20,
    seed: int = 0,
    azimuth_step: float = 0.35,
    scans_per_street: int = 1,
    workers: int = 1,
    progress: bool = True,
) -> Path:
    """Make a synthetic SemanticKITTI data set, or leave it as it is where it is complete and of these parameters.

    Training streets go round the sequences 00-07, 09 and 10; the others are sequence 08.

    Args:
        root: Folder to fill; a folder that holds anything else is refused.
        num_train: Training scans.
        num_val: Scans of sequence 08.
        seed: Another seed makes other streets.
        azimuth_step: Degrees between two firings. Larger: fewer points, faster.
        scans_per_street: Scans taken one after the other, a metre apart; 1: each scan sees a street of its own.
        workers: Processes; the result does not depend on it.
        progress: Show a bar.

    Returns:
        The root as a path.

    Raises:
        ValueError: The folder holds files that this function did not make, or a number is out of range.
    """
    root = Path(root)
    check_counts(num_train=num_train, num_val=num_val)
    if not 1 <= scans_per_street <= 20:
        raise ValueError(f'scans_per_street: expected 1 to 20, since streets end; got {scans_per_street}')
    lidar = SpinningLidar(azimuth_step)
    plan: dict[int, list[tuple[int, int]]] = {}
    for count, first, sequences in ((num_train, 0, TRAIN), (num_val, VAL_STREETS, VAL)):
        for number in range(count):
            street, step = divmod(number, scans_per_street)
            plan.setdefault(sequences[street % len(sequences)], []).append((first + street, step))
    todo = [
        (root / 'sequences' / f'{sequence:02d}', partial(_write_sequence, seed, tuple(scans), lidar))
        for sequence, scans in sorted(plan.items())
    ]
    recipe = {
        'format': 'semantickitti',
        'version': STREETS_VERSION,
        'synthetic': True,
        'seed': seed,
        'azimuth_step': azimuth_step,
        'scans_per_street': scans_per_street,
        'num_train': num_train,
        'num_val': num_val,
    }
    title = 'synthetic sequences'
    return fill_demo(root, recipe, {}, ('sequences',), README, todo, _nothing, workers, progress, title)


def _nothing() -> None:
    """There are no lists to write."""


def _write_sequence(seed: int, scans: tuple[tuple[int, int], ...], lidar: SpinningLidar, folder: Path) -> None:
    for name in ('velodyne', 'labels'):
        (folder / name).mkdir()
    poses = []
    for number, (street, step) in enumerate(scans):
        returned, pose = make_scan(seed, street, step, lidar)
        raw, instance = raw_labels(returned)
        points = np.concatenate([returned.xyz, returned.intensity[:, None]], axis=1)
        write_bytes(folder / 'velodyne' / f'{number:06d}.bin', points.astype('<f4').tobytes())
        write_bytes(folder / 'labels' / f'{number:06d}.label', pack_labels(raw, instance))
        poses.append(pose)
    camera = f'Tr: {_row(CAMERA_FROM_LIDAR)}\n'
    write_bytes(folder / 'calib.txt', camera.encode('ascii'))
    lines = [_row(camera_pose(pose)) for pose in poses]
    write_bytes(folder / 'poses.txt', ('\n'.join(lines) + '\n').encode('ascii'))


def make_scan(seed: int, street: int, step: int, lidar: SpinningLidar) -> tuple[LabelledScan, Float[np.ndarray, '4 4']]:
    """One scan, and its pose in a world where streets lie a kilometre apart; depends on nothing but the arguments."""
    scene = make_scene(seed, street)
    pose = pose_on_road(scene.road, step * STEP)
    matrix = pose.matrix
    matrix[1, 3] += 1000.0 * (street % VAL_STREETS)
    return scan_scene(scene, pose, lidar, generator(seed, street, 2 + step)), matrix


def raw_labels(scan: LabelledScan) -> tuple[Int[np.ndarray, ' points'], Int[np.ndarray, ' points']]:
    """Raw ids, and instance numbers from 1 for things, 0 elsewhere; every third thing that can move does.

    As in real scans nobody labels what lies far away, what lies between two things, and some of what has no class.
    """
    table = np.zeros(len(Part), dtype=np.int64)
    moving = np.zeros(len(Part), dtype=np.int64)
    for part, raw in RAW_IDS.items():
        table[part], moving[part] = raw, MOVING.get(raw, raw)
    reach = np.sqrt(scan.xyz[:, 0] ** 2 + scan.xyz[:, 1] ** 2)
    forgotten = (scan.part == Part.OBJECT) & (scan.thing % 2 == 1)
    labelled = (reach < LABELLED) & ~scan.mixed & ~forgotten
    resting = np.where(labelled, table[scan.part], 0)
    instance = np.where(np.isin(resting, _THINGS), scan.thing + 1, 0)
    return np.where(labelled & (scan.thing % 3 == 0), moving[scan.part], resting), instance


def camera_pose(lidar_pose: Float[np.ndarray, '4 4']) -> Float[np.ndarray, '4 4']:
    """World from lidar as ``poses.txt`` has it: about the camera, in the camera's axes."""
    return _product(_product(CAMERA_FROM_LIDAR, lidar_pose), invert_affine(CAMERA_FROM_LIDAR))


def _product(a: Float[np.ndarray, '4 4'], b: Float[np.ndarray, '4 4']) -> Float[np.ndarray, '4 4']:
    """Written out, so that the bits do not depend on a library."""
    product: Float[np.ndarray, '4 4'] = a[:, :1] * b[:1] + a[:, 1:2] * b[1:2] + a[:, 2:3] * b[2:3] + a[:, 3:] * b[3:]
    return product


def _row(matrix: Float[np.ndarray, '4 4']) -> str:
    return ' '.join(f'{value:.9e}' for value in (np.round(matrix[:3], 9) + 0.0).ravel().tolist())
