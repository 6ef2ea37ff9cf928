"""Things that stand in rooms: named meshes with materials, and the bodies that furniture is made of.

A thing's own frame: metres, z up, origin on the floor below its middle, its front towards +x.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from rm3d_plugin.datasets.synthetic.room_materials import Material
from rm3d_plugin.datasets.synthetic.shapes import Mesh, Point, box, cos_sin, grid_quads, join, mesh, quads, tube

Part = tuple[Mesh, Material]
Point3 = tuple[float, float, float]


class Category(NamedTuple):
    """What the label sets call a kind of thing.

    Attributes:
        category: ScanNet's cleaned name.
        nyu40: Number in NYU's forty classes; 0 = not annotated in ScanNet.
        nyu40_name: Its name.
        s3dis: S3DIS' class.
    """

    category: str
    nyu40: int
    nyu40_name: str
    s3dis: str = 'clutter'


# Raw names as an annotator would type them.
CATEGORIES: dict[str, Category] = {
    'wall': Category('wall', 1, 'wall', 'wall'),
    'floor': Category('floor', 2, 'floor', 'floor'),
    'kitchen cabinet': Category('cabinet', 3, 'cabinet'),
    'cabinet': Category('cabinet', 3, 'cabinet'),
    'wardrobe closet': Category('wardrobe', 3, 'cabinet'),
    'bed': Category('bed', 4, 'bed'),
    'chair': Category('chair', 5, 'chair', 'chair'),
    'office chair': Category('office chair', 5, 'chair', 'chair'),
    'armchair': Category('armchair', 5, 'chair', 'chair'),
    'couch': Category('couch', 6, 'sofa', 'sofa'),
    'table': Category('table', 7, 'table', 'table'),
    'coffee table': Category('coffee table', 7, 'table', 'table'),
    'door': Category('door', 8, 'door', 'door'),
    'window': Category('window', 9, 'window', 'window'),
    'bookshelf': Category('bookshelf', 10, 'bookshelf', 'bookcase'),
    'picture': Category('picture', 11, 'picture'),
    'counter': Category('counter', 12, 'counter', 'table'),
    'desk': Category('desk', 14, 'desk', 'table'),
    'curtain': Category('curtain', 16, 'curtain'),
    'dresser': Category('dresser', 17, 'dresser'),
    'pillow': Category('pillow', 18, 'pillow'),
    'mirror': Category('mirror', 19, 'mirror'),
    'ceiling': Category('ceiling', 22, 'ceiling', 'ceiling'),
    'books': Category('books', 23, 'books'),
    'refrigerator': Category('refrigerator', 24, 'refridgerator'),
    'tv': Category('tv', 25, 'television'),
    'shower curtain': Category('shower curtain', 28, 'shower curtain'),
    'box': Category('box', 29, 'box'),
    'whiteboard': Category('whiteboard', 30, 'whiteboard', 'board'),
    'nightstand': Category('nightstand', 32, 'night stand'),
    'toilet': Category('toilet', 33, 'toilet'),
    'sink': Category('sink', 34, 'sink'),
    'lamp': Category('lamp', 35, 'lamp'),
    'bathtub': Category('bathtub', 36, 'bathtub'),
    'bag': Category('bag', 37, 'bag'),
    'column': Category('column', 38, 'otherstructure', 'column'),
    'beam': Category('beam', 38, 'otherstructure', 'beam'),
    'ottoman': Category('ottoman', 39, 'otherfurniture'),
    'radiator': Category('radiator', 39, 'otherfurniture'),
    'trash can': Category('trash can', 39, 'otherfurniture'),
    'tv stand': Category('tv stand', 39, 'otherfurniture'),
    'monitor': Category('monitor', 40, 'otherprop'),
    'plant': Category('plant', 40, 'otherprop'),
    'bottle': Category('bottle', 40, 'otherprop'),
    'object': Category('object', 0, 'unannotated'),
}
SCANNET_CLASSES = (
    'wall', 'floor', 'cabinet', 'bed', 'chair', 'sofa', 'table', 'door', 'window', 'bookshelf', 'picture', 'counter',
    'desk', 'curtain', 'refridgerator', 'shower curtain', 'toilet', 'sink', 'bathtub', 'otherfurniture',
)  # fmt: skip
S3DIS_CLASSES = (
    'ceiling', 'floor', 'wall', 'beam', 'column', 'window', 'door', 'table', 'chair', 'sofa', 'bookcase', 'board',
    'clutter',
)  # fmt: skip


class Top(NamedTuple):
    """A level rectangle that can carry small things: x and y from .. to, and its height."""

    x: tuple[float, float]
    y: tuple[float, float]
    z: float


@dataclass(frozen=True, eq=False)
class Thing:
    """A labelled thing.

    Attributes:
        name: Key of CATEGORIES.
        parts: Its meshes, each of one material.
        tops: Where small things may stand.
    """

    name: str
    parts: tuple[Part, ...]
    tops: tuple[Top, ...] = ()

    def moved(self, shift: Point, yaw: float = 0.0) -> 'Thing':
        """Turned about z (radians), then shifted; its tops are of its own frame and go."""
        return Thing(self.name, tuple((body.moved(shift, yaw), material) for body, material in self.parts))

    @property
    def bounds(self) -> tuple[Float[np.ndarray, '3'], Float[np.ndarray, '3']]:
        """Lowest and highest coordinates."""
        return join([body for body, _ in self.parts]).bounds


def thing(name: str, parts: Sequence[Part], tops: Sequence[Top] = ()) -> Thing:
    """A thing; its name must be one of CATEGORIES."""
    if name not in CATEGORIES:
        raise ValueError(f'thing: expected a name of CATEGORIES, got {name!r}')
    return Thing(name, tuple(parts), tuple(tops))


def block(low: Point3, high: Point3) -> Mesh:
    """A box between two corners."""
    a, b = np.asarray(low), np.asarray(high)
    return box((a + b) / 2, b - a, 0.5)


def rod(start: Point3, end: Point3, radius: float, sides: int = 6) -> Mesh:
    """A round bar."""
    return tube(start, end, (radius, radius), 0.5, sides)


def rings(
    outline: Float[np.ndarray, 'points 2'],
    levels: Sequence[tuple[float, float]],
    lids: tuple[bool, bool] = (True, True),
) -> Mesh:
    """An upright body: an outline scaled about its middle, at each (z, scale); lids close its first and last ring."""
    middle = (outline.min(axis=0) + outline.max(axis=0)) / 2
    stack = []
    for z, scale in levels:
        flat = middle + (outline - middle) * scale
        stack.append(np.concatenate([flat, np.full((len(flat), 1), z)], axis=1))
    closed = np.stack([np.concatenate([ring, ring[:1]]) for ring in stack])
    caps = [_fan(ring) for ring, closing in zip((stack[0], stack[-1]), lids, strict=True) if closing]
    return join([quads(grid_quads(closed), 0.5), *caps])


def _fan(ring: Float[np.ndarray, 'points 3']) -> Mesh:
    low, high = ring.min(axis=0), ring.max(axis=0)
    middle = np.broadcast_to((low + high) / 2, ring.shape)
    return mesh(np.stack([middle, ring, np.roll(ring, -1, axis=0)], axis=1), 0.5)


def ellipse(center: tuple[float, float], radii: tuple[float, float], sides: int = 16) -> Float[np.ndarray, 'points 2']:
    """An ellipse, counter-clockwise."""
    c, s = cos_sin(np.arange(sides) * (2 * np.pi / sides))
    return np.stack([center[0] + radii[0] * c, center[1] + radii[1] * s], axis=1)


def rounded(center: tuple[float, float], size: tuple[float, float], radius: float) -> Float[np.ndarray, 'points 2']:
    """A rectangle with round corners, counter-clockwise."""
    radius = min(radius, 0.49 * size[0], 0.49 * size[1])
    corners = []
    for quarter, (sx, sy) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        c, s = cos_sin((quarter + np.arange(4) / 3) * (np.pi / 2))
        x = center[0] + sx * (size[0] / 2 - radius) + radius * c
        corners.append(np.stack([x, center[1] + sy * (size[1] / 2 - radius) + radius * s], axis=1))
    return np.concatenate(corners)


def cushion(low: Point3, high: Point3, soft: float = 0.05) -> Mesh:
    """A box with round edges."""
    size = (high[0] - low[0], high[1] - low[1])
    outline = rounded(((low[0] + high[0]) / 2, (low[1] + high[1]) / 2), size, soft)
    tall = high[2] - low[2]
    inset = 1 - min(soft, 0.3 * min(size)) / max(min(size), 1e-6)
    lip = min(soft, tall / 3)
    return rings(outline, [(low[2], inset), (low[2] + lip, 1.0), (high[2] - lip, 1.0), (high[2], inset)])


def tilted(body: Mesh, angle: float, pivot: Point3) -> Mesh:
    """Leant back by an angle (radians) about the y axis through a point."""
    c, s = (float(v) for v in cos_sin(angle))
    x, z = body.corners[..., 0] - pivot[0], body.corners[..., 2] - pivot[2]
    corners = np.stack([c * x - s * z + pivot[0], body.corners[..., 1], s * x + c * z + pivot[2]], axis=-1)
    return Mesh(np.round(corners, 6), body.reflectance, body.dropout)


def holed_sheet(width: float, height: float, holes: Sequence[tuple[float, float, float, float]], depth: float) -> Mesh:
    """A sheet in the plane y = 0 from (0, 0) to (width, height) in (x, z), with holes and their reveals.

    Args:
        width: Metres along x.
        height: Metres along z.
        holes: (x from, x to, z from, z to), sorted along x and apart from each other.
        depth: How far the reveals reach towards -y.
    """
    flat, at = [], 0.0
    for x0, x1, z0, z1 in holes:
        flat += [(at, x0, 0.0, height), (x0, x1, 0.0, z0), (x0, x1, z1, height)]
        at = x1
    flat.append((at, width, 0.0, height))
    faces: list[list[tuple[float, float, float]]] = [
        [(a, 0, c), (b, 0, c), (b, 0, d), (a, 0, d)] for a, b, c, d in flat if b - a > 1e-6 and d - c > 1e-6
    ]
    for x0, x1, z0, z1 in holes:
        corners = [(x0, z0), (x1, z0), (x1, z1), (x0, z1)]
        for (ax, az), (bx, bz) in zip(corners, corners[1:] + corners[:1], strict=True):
            if max(az, bz) > 1e-6:
                faces.append([(ax, 0, az), (bx, 0, bz), (bx, -depth, bz), (ax, -depth, az)])
    return quads(np.array(faces, dtype=np.float64), 0.5)


def upright(flat: Mesh) -> Mesh:
    """A sheet of the (x, z) plane laid down: z becomes y, -y becomes -z (holes then go downwards)."""
    x, y, z = (flat.corners[..., i] for i in range(3))
    return Mesh(np.stack([x, z, y], axis=-1), flat.reflectance, flat.dropout)


def wavy_sheet(width: float, low: float, high: float, waves: float, swing: float, phase: float) -> Mesh:
    """A hanging cloth around the plane x = 0, its folds along y."""
    columns = max(8, int(waves * 6) + 1)
    y = np.linspace(-width / 2, width / 2, columns)
    folds = cos_sin(np.arange(columns) * (2 * np.pi * waves / (columns - 1)) + phase)[1]
    z = np.array([high, 0.5 * (low + high), low])
    loose = np.array([0.5, 0.9, 1.0])
    grid = np.stack(np.broadcast_arrays(swing * loose[:, None] * folds, y, z[:, None]), axis=-1)
    return quads(grid_quads(grid), 0.5)
