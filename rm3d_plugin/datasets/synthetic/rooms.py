"""Made-up rooms, scanned by a virtual depth camera: the indoor demo data.

A room depends on its seed and number alone. ``spacing`` changes how densely it is scanned, not what is in it.
"""

from dataclasses import dataclass
from typing import get_args

import numpy as np
from jaxtyping import Float, Int, UInt8

from rm3d_plugin.datasets.synthetic.room_annotation import CUT, SMALL, annotate, cut_parts, overlooked
from rm3d_plugin.datasets.synthetic.room_fusion import fuse, mesh_faces, mesh_segments, smoothed
from rm3d_plugin.datasets.synthetic.room_kinds import random_layout
from rm3d_plugin.datasets.synthetic.room_layout import Layout
from rm3d_plugin.datasets.synthetic.room_scanner import DepthCamera, Scanner, View, plan_views, shoot, surfaces_of
from rm3d_plugin.datasets.synthetic.room_things import CATEGORIES
from rm3d_plugin.datasets.synthetic.shapes import cos_sin

SPACING = 0.035  # m between points
# Kinds of rooms in turn: every eight have each of the first five and a studio, and two that change.
TURNS = tuple(
    kind
    for pair in (('bathroom', 'conference'), ('conference', 'hallway'), ('office', 'conference'))
    for kind in ('office', 'bathroom', 'bedroom', 'kitchen', 'living', 'studio', *pair)
)
SEGMENT = 0.25  # threshold of the segments that people colour
SEGMENT_AREA = 0.025  # m^2; smaller segments join a neighbour
MISSED = (-0.2, 0.15)  # about the share of the small segments that are not annotated
FINEST, COARSEST = 0.002, 0.2  # m


@dataclass(frozen=True, eq=False)
class RoomScan:
    """A scanned room.

    Attributes:
        kind: One of ROOM_KINDS.
        xyz: (N, 3) float32 metres, the scanner's own frame: z up, turned and shifted against the walls.
        colors: (N, 3) uint8 RGB.
        normals: (N, 3) float32 unit normals of the true surfaces, towards the camera, the same frame as ``xyz``.
        instance: (N,) int64 row of ``things``; every thing has points.
        segment: (N,) int64 small segment of the mesh, numbered by first point; none crosses a thing.
        faces: (M, 3) int32 triangles of the mesh over the points.
        things: Raw name (key of CATEGORIES) of each thing that was seen.
        axis_alignment: (4, 4) float64 takes ``xyz`` to the room frame, whose axes follow the walls.
    """

    kind: str
    xyz: Float[np.ndarray, 'points 3']
    colors: UInt8[np.ndarray, 'points 3']
    normals: Float[np.ndarray, 'points 3']
    instance: Int[np.ndarray, ' points']
    segment: Int[np.ndarray, ' points']
    faces: Int[np.ndarray, 'faces 3']
    things: tuple[str, ...]
    axis_alignment: Float[np.ndarray, '4 4']

    def __len__(self) -> int:
        return len(self.xyz)

    @property
    def names(self) -> np.ndarray:
        """(N,) raw name of each point's thing."""
        return np.array(self.things)[self.instance]

    @property
    def nyu40(self) -> Int[np.ndarray, ' points']:
        """(N,) number in NYU's forty classes, 0 = not annotated."""
        return np.array([CATEGORIES[name].nyu40 for name in self.things], dtype=np.int64)[self.instance]

    @property
    def s3dis(self) -> np.ndarray:
        """(N,) S3DIS' class name."""
        return np.array([CATEGORIES[name].s3dis for name in self.things])[self.instance]

    @property
    def aligned(self) -> Float[np.ndarray, 'points 3']:
        """(N, 3) float64 metres in the room frame."""
        return _apply(self.axis_alignment, self.xyz.astype(np.float64))


def room_kind(index: int) -> str:
    """Rooms take turns, so that rooms in a row are of many kinds."""
    return TURNS[index % len(TURNS)]


def make_layout(seed: int, index: int, kind: str | None = None, structure: float = 0.25) -> Layout:
    """What is in a room, before it is scanned."""
    return random_layout(_generator(seed, index, 0), room_kind(index) if kind is None else kind, structure)


def make_room(
    seed: int,
    index: int,
    spacing: float = SPACING,
    kind: str | None = None,
    scanner: Scanner = 'handheld',
    structure: float = 0.25,
) -> RoomScan:
    """A scanned room; depends on nothing but the arguments.

    Args:
        seed: Another seed makes other rooms.
        index: Number of the room.
        spacing: Metres between points. Smaller: more points of the same room, about as 1 / spacing^2 (0.035: 45
            thousand, 0.006: up to 3 million).
        kind: One of ROOM_KINDS; None: by the number.
        scanner: 'handheld' walks and leaves many holes, 'tripod' turns at a few places and sees the ceiling.
        structure: Chance of columns and beams.

    Raises:
        ValueError: A spacing out of range, an unknown kind or scanner.
    """
    if not FINEST <= spacing <= COARSEST:
        raise ValueError(f'spacing: expected {FINEST} to {COARSEST} m, got {spacing}')
    if scanner not in get_args(Scanner):
        raise ValueError(f'scanner: expected one of {", ".join(get_args(Scanner))}, got {scanner!r}')
    layout = make_layout(seed, index, kind, structure)
    views = plan_views(layout, scanner, _generator(seed, index, 1))
    return scan_room(layout, views, spacing, scanner, _generator(seed, index, 2))


def scan_room(
    layout: Layout, views: list[View], spacing: float, scanner: Scanner, rng: np.random.Generator
) -> RoomScan:
    """Scan a room from given views."""
    camera = DepthCamera.for_spacing(spacing, scanner).of_quality(0.7 + 0.6 * rng.random())
    shots = shoot(layout, surfaces_of(layout), views, camera, rng)
    fused = smoothed(fuse(shots, spacing), spacing)
    faces = mesh_faces(fused, shots, 2.5 * spacing + 4 * camera.pitch)
    names = [item.name for item in layout.things]
    least, cut, small = (max(1, round(area / spacing**2)) for area in (SEGMENT_AREA, CUT, SMALL))
    segment = mesh_segments(faces, fused.normals, fused.colors, np.zeros_like(fused.thing), SEGMENT, least)
    pieces = cut_parts(segment, fused.thing, len(names), cut)
    segment = mesh_segments(faces, fused.normals, fused.colors, pieces, SEGMENT, least)
    thing = annotate(segment, fused.thing, len(names))
    missed = MISSED[0] + (MISSED[1] - MISSED[0]) * rng.random()
    if scanner == 'handheld':  # areas that a tripod scanned were annotated completely
        names.append('object')
        thing = np.where(overlooked(fused.xyz, segment, missed, small), len(layout.things), thing)
    seen, instance = np.unique(thing, return_inverse=True)
    alignment = _random_alignment(rng)
    back = _inverse(alignment)
    xyz = _apply(back, fused.xyz).astype(np.float32)
    back[:3, 3] = 0
    return RoomScan(
        layout.kind,
        xyz,
        np.floor(fused.colors * 255 + 0.5).astype(np.uint8),
        _apply(back, fused.normals).astype(np.float32),
        instance.astype(np.int64),
        segment,
        faces,
        tuple(names[k] for k in seen),
        alignment,
    )


def _generator(seed: int, index: int, purpose: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, index, purpose])))


def _random_alignment(rng: np.random.Generator) -> Float[np.ndarray, '4 4']:
    """Six decimals, as the files hold it."""
    c, s = (float(v) for v in cos_sin(2 * np.pi * rng.random()))
    shift = np.array([*(6 * rng.random(2) - 3), -0.1 * rng.random()])
    matrix = np.eye(4)
    matrix[:2, :2] = [[c, -s], [s, c]]
    matrix[:3, 3] = shift
    return np.round(matrix, 6)


def _inverse(matrix: Float[np.ndarray, '4 4']) -> Float[np.ndarray, '4 4']:
    """Of a turn about z with a shift."""
    a, b, c, d = matrix[0, 0], matrix[0, 1], matrix[1, 0], matrix[1, 1]
    area = a * d - b * c
    out = np.eye(4)
    out[:2, :2] = np.array([[d, -b], [-c, a]]) / area
    x, y, z = -matrix[:3, 3]
    out[:3, 3] = [out[0, 0] * x + out[0, 1] * y, out[1, 0] * x + out[1, 1] * y, z]
    return out


def _apply(matrix: Float[np.ndarray, '4 4'], xyz: Float[np.ndarray, 'points 3']) -> Float[np.ndarray, 'points 3']:
    """Plain sums: a matrix product rounds as its library likes."""
    rows = [
        matrix[i, 0] * xyz[:, 0] + matrix[i, 1] * xyz[:, 1] + matrix[i, 2] * xyz[:, 2] + matrix[i, 3] for i in range(3)
    ]
    return np.stack(rows, axis=1)
