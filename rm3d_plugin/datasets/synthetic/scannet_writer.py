"""Synthetic rooms as a ScanNet data set: scans/, the label map and the lists of scenes."""

import json
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Int, UInt8

from rm3d_plugin.datasets.synthetic.room_demo import ROOMS_VERSION, fill_demo
from rm3d_plugin.datasets.synthetic.room_things import CATEGORIES
from rm3d_plugin.datasets.synthetic.rooms import SPACING, RoomScan, make_room
from rm3d_plugin.storage import write_bytes

README = """This folder is SYNTHETIC. rm3d_plugin made it: parametric rooms, scanned by a virtual depth camera.
The files have the format of ScanNet, but none of the content comes from ScanNet, and a score on them says nothing about
real data. demo.json holds the parameters; delete the folder to make it afresh.
"""
LABEL_MAP = 'scannetv2-labels.combined.tsv'
_SCENE_TYPES = {
    'office': 'Office', 'bathroom': 'Bathroom', 'bedroom': 'Bedroom / Hotel', 'kitchen': 'Kitchen',
    'living': 'Living room / Lounge', 'studio': 'Apartment', 'conference': 'Conference Room', 'hallway': 'Hallway',
}  # fmt: skip


def make_scannet_rooms(
    root: Path | str,
    num_train: int = 24,
    num_val: int = 8,
    num_test: int = 0,
    seed: int = 0,
    spacing: float = SPACING,
    workers: int = 1,
    progress: bool = True,
) -> Path:
    """Make a synthetic ScanNet data set, or leave it as it is where it is complete and of these parameters.

    Args:
        root: Folder to fill; a folder that holds anything else is refused.
        num_train: Rooms 0 .. num_train - 1.
        num_val: The rooms after them.
        num_test: The rooms after those, in scans_test, without labels.
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
    if min(num_train, num_val, num_test) < 0 or num_train + num_val + num_test == 0:
        raise ValueError(f'expected rooms, got num_train={num_train}, num_val={num_val}, num_test={num_test}')
    ends = np.cumsum([num_train, num_val, num_test])
    todo = []
    for number in range(ends[2]):
        hidden = number >= ends[1]
        folder = root / ('scans_test' if hidden else 'scans') / scene_name(number)
        todo.append((folder, partial(_write_room, seed, number, spacing, not hidden)))

    def finish() -> None:
        write_bytes(root / LABEL_MAP, label_map_text().encode('ascii'))
        for name, first, last in zip(('train', 'val', 'test'), (0, *ends[:2]), ends, strict=True):
            lines = ''.join(f'{scene_name(number)}\n' for number in range(first, last))
            write_bytes(root / f'scannetv2_{name}.txt', lines.encode('ascii'))

    return fill_demo(
        root,
        {'format': 'scannet', 'version': ROOMS_VERSION, 'synthetic': True, 'seed': seed, 'spacing': spacing},
        {'num_train': num_train, 'num_val': num_val, 'num_test': num_test},
        ('scans', 'scans_test'),
        README,
        todo,
        finish,
        workers,
        progress,
        'synthetic rooms (ScanNet)',
    )


def scene_name(number: int) -> str:
    """ScanNet's name of a scan: the first scan of scene ``number``."""
    return f'scene{number:04d}_00'


def _write_room(seed: int, number: int, spacing: float, labelled: bool, folder: Path) -> None:
    write_scene(folder, scene_name(number), make_room(seed, number, spacing), labelled)


def write_scene(folder: Path, name: str, room: RoomScan, labelled: bool = True) -> None:
    """Write a scan's files into an existing folder.

    Args:
        folder: Where to.
        name: Scene name, the start of each file's name.
        room: The scan.
        labelled: Also write segments, instances and labels, which the test scans lack.
    """
    mesh = f'{name}_vh_clean_2'
    write_bytes(folder / f'{mesh}.ply', mesh_ply(room, room.colors))
    write_bytes(folder / f'{name}.txt', scene_text(room).encode('ascii'))
    if not labelled:
        return
    segments = f'{name}_vh_clean_2.0.010000.segs.json'
    write_bytes(folder / segments, segments_json(name, room).encode('ascii'))
    write_bytes(folder / f'{name}.aggregation.json', aggregation_json(name, room).encode('ascii'))
    labels = room.nyu40
    write_bytes(folder / f'{mesh}.labels.ply', mesh_ply(room, _label_colors(labels), labels))


def mesh_ply(
    room: RoomScan, colors: UInt8[np.ndarray, 'points 3'], labels: Int[np.ndarray, ' points'] | None = None
) -> bytes:
    """A mesh as ScanNet writes it: binary, little endian; labels add a column."""
    columns = [('xyz', '<f4', 3), ('rgb', 'u1', 3), ('alpha', 'u1')]
    header = ['x', 'y', 'z']
    text = ['ply', 'format binary_little_endian 1.0', 'comment synthetic room made by rm3d_plugin']
    text.append(f'element vertex {len(room)}')
    text += [f'property float {axis}' for axis in header]
    text += [f'property uchar {channel}' for channel in ('red', 'green', 'blue', 'alpha')]
    if labels is not None:
        columns.append(('label', '<u2'))
        text.append('property ushort label')
    text += [f'element face {len(room.faces)}', 'property list uchar int vertex_indices', 'end_header', '']
    vertices = np.zeros(len(room), dtype=np.dtype(columns))
    vertices['xyz'], vertices['rgb'], vertices['alpha'] = room.xyz, colors, 255
    if labels is not None:
        vertices['label'] = labels
    faces = np.zeros(len(room.faces), dtype=np.dtype([('count', 'u1'), ('corners', '<i4', 3)]))
    faces['count'], faces['corners'] = 3, room.faces
    return '\n'.join(text).encode('ascii') + vertices.tobytes() + faces.tobytes()


def scene_text(room: RoomScan) -> str:
    """The scan's facts; the matrix takes raw coordinates to the axes of the room."""
    numbers = ' '.join(f'{value:.6f}' for value in room.axis_alignment.ravel())
    return f'axisAlignment = {numbers}\nsceneType = {_SCENE_TYPES[room.kind]}\n'


def segments_json(name: str, room: RoomScan) -> str:
    """Segment of each vertex."""
    content = {
        'params': {'kThresh': '0.0100000000', 'segMinVerts': '20', 'minPoints': '750', 'maxPoints': '30000'},
        'sceneId': name,
        'segIndices': room.segment.tolist(),
    }
    return json.dumps(content, separators=(',', ':'))


def aggregation_json(name: str, room: RoomScan) -> str:
    """Instances as lists of segments; what has no class in ScanNet is in none."""
    groups: list[dict[str, object]] = []
    segments = [np.unique(room.segment[room.instance == k]).tolist() for k in range(len(room.things))]
    for raw, members in zip(room.things, segments, strict=True):
        if CATEGORIES[raw].nyu40:
            groups.append({'id': len(groups), 'objectId': len(groups), 'segments': members, 'label': raw})
    content = {
        'sceneId': f'scannet.{name}',
        'appId': 'Aggregator.v2',
        'segGroups': groups,
        'segmentsFile': f'scannet.{name}_vh_clean_2.0.010000.segs.json',
    }
    return json.dumps(content, separators=(',', ':'))


def label_map_text() -> str:
    """The columns of ScanNet's label map that tools read."""
    lines = ['id\traw_category\tcategory\tcount\tnyu40id\tnyu40class']
    named = [(raw, item) for raw, item in CATEGORIES.items() if item.nyu40]
    for number, (raw, item) in enumerate(named, start=1):
        lines.append(f'{number}\t{raw}\t{item.category}\t1\t{item.nyu40}\t{item.nyu40_name}')
    return '\n'.join(lines) + '\n'


def _label_colors(labels: Int[np.ndarray, ' points']) -> UInt8[np.ndarray, 'points 3']:
    """A colour for each number; 0 is black."""
    table = np.array(
        [[(37 * k * k + 91 * k * c + 53 * c * k * k) % 200 + 40 * (k > 0) for c in range(3)] for k in range(41)]
    )
    return table.astype(np.uint8)[labels]
