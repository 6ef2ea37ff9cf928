"""Synthetic rooms as an S3DIS data set: six areas of rooms, each thing a text file."""

from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.datasets.synthetic.room_demo import ROOMS_VERSION, fill_demo
from rm3d_plugin.datasets.synthetic.room_things import CATEGORIES
from rm3d_plugin.datasets.synthetic.rooms import RoomScan, make_room
from rm3d_plugin.storage import write_bytes

README = """This folder is SYNTHETIC. rm3d_plugin made it: parametric rooms, scanned by a virtual depth camera.
The files have the format of S3DIS, but none of the content comes from S3DIS, and a score on them says nothing about
real data. demo.json holds the parameters; delete the folder to make it afresh.
"""
AREAS = 6
SPACING = 0.045  # m between points; a tripod sees the whole of a room
# Kinds of rooms in turn, and S3DIS' names of them.
ROOM_TYPES = (
    ('office', 'office'), ('conference', 'conferenceRoom'), ('living', 'lounge'), ('hallway', 'hallway'),
    ('office', 'office'), ('living', 'openspace'),
)  # fmt: skip


def make_s3dis_rooms(
    root: Path | str,
    rooms_per_area: int = 5,
    seed: int = 0,
    spacing: float = SPACING,
    workers: int = 1,
    progress: bool = True,
) -> Path:
    """Make a synthetic S3DIS data set, or leave it as it is where it is complete and of these parameters.

    Args:
        root: Folder to fill; a folder that holds anything else is refused.
        rooms_per_area: Rooms in each of Area_1 to Area_6.
        seed: Another seed makes other rooms.
        spacing: Metres between points.
        workers: Processes; the result does not depend on it.
        progress: Show a bar.

    Returns:
        The root as a path.

    Raises:
        ValueError: The folder holds files that this function did not make, or a number is out of range.
    """
    root = Path(root)
    if rooms_per_area < 1:
        raise ValueError(f'rooms_per_area: expected at least 1, got {rooms_per_area}')
    todo = []
    for area in range(AREAS):
        for number, name in enumerate(room_names(area, rooms_per_area)):
            write = partial(_write_room, seed, area, area * rooms_per_area + number, number, spacing)
            todo.append((root / f'Area_{area + 1}' / name, write))
    return fill_demo(
        root,
        {
            'format': 's3dis',
            'version': ROOMS_VERSION,
            'synthetic': True,
            'seed': seed,
            'spacing': spacing,
            'rooms_per_area': rooms_per_area,
        },  # fmt: skip
        {},
        [f'Area_{area + 1}' for area in range(AREAS)],
        README,
        todo,
        lambda: None,
        workers,
        progress,
        'synthetic rooms (S3DIS)',
    )


def room_names(area: int, count: int) -> list[str]:
    """Names of an area's rooms, numbered by type from 1."""
    names: list[str] = []
    for number in range(count):
        kind = ROOM_TYPES[(number + area) % len(ROOM_TYPES)][1]
        names.append(f'{kind}_{1 + sum(name.startswith(f"{kind}_") for name in names)}')
    return names


def _write_room(seed: int, area: int, index: int, number: int, spacing: float, folder: Path) -> None:
    kind = ROOM_TYPES[(number + area) % len(ROOM_TYPES)][0]
    room = make_room(seed, index, spacing, kind, 'tripod', structure=0.6)
    name = room_names(area, number + 1)[-1]
    write_room(folder, name, room, (12.0 * number - 20.0, 15.0 * area - 30.0, 0.0))


def write_room(folder: Path, name: str, room: RoomScan, shift: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
    """Write a room's files into an existing folder.

    S3DIS' coordinates follow the walls, so the room frame is written.

    Args:
        folder: Where to.
        name: Room name; its file is NAME.txt.
        room: The scan.
        shift: Metres from the room frame to the building's.
    """
    lines = point_lines(room.aligned + np.array(shift), room.colors.astype(np.int64))
    write_bytes(folder / f'{name}.txt', ''.join(lines).encode('ascii'))
    annotations = folder / 'Annotations'
    annotations.mkdir(exist_ok=True)
    counts: dict[str, int] = {}
    order = np.argsort(room.instance, kind='stable')
    ends = np.cumsum(np.bincount(room.instance, minlength=len(room.things)))
    for members, raw in zip(np.split(order, ends[:-1]), room.things, strict=True):
        kind = CATEGORIES[raw].s3dis
        counts[kind] = counts.get(kind, 0) + 1
        text = ''.join(lines[i] for i in members)
        write_bytes(annotations / f'{kind}_{counts[kind]}.txt', text.encode('ascii'))


def point_lines(xyz: Float[np.ndarray, 'points 3'], rgb: Int[np.ndarray, 'points 3']) -> list[str]:
    """``x y z r g b`` of each point, metres with three decimals."""
    rows = zip(np.round(xyz, 3).tolist(), rgb.tolist(), strict=True)
    return [f'{x:.3f} {y:.3f} {z:.3f} {r} {g} {b}\n' for (x, y, z), (r, g, b) in rows]
