"""Triangle meshes and the simple bodies that everything in a synthetic scene is made of.

All lengths are metres, z is up, a body's own frame has its origin on the ground below its middle and heads along +x.
Sines and cosines are rounded to 12 digits and vertices to a micrometre, so that the same seed gives the same bits with
any mathematics library.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int

Point = Sequence[float] | np.ndarray
NO_PART: Int[np.ndarray, ' none'] = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Mesh:
    """A soup of triangles with what a laser needs to know of their surface.

    Attributes:
        corners: (F, 3, 3) float64 metres: triangle, corner, coordinate.
        reflectance: (F,) float64 in [0, 1].
        dropout: (F,) float64 in [0, 1], the chance that a return is lost (glass).
        part: (F,) int64, what each triangle is (:class:`~rm3d_plugin.datasets.synthetic.parts.Part`); 0 where nobody
            said.
    """

    corners: Float[np.ndarray, 'faces 3 3']
    reflectance: Float[np.ndarray, ' faces']
    dropout: Float[np.ndarray, ' faces']
    part: Int[np.ndarray, ' faces'] = field(default_factory=lambda: NO_PART)

    def __post_init__(self) -> None:
        if self.part is NO_PART:
            object.__setattr__(self, 'part', np.zeros(len(self.corners), dtype=np.int64))

    def __len__(self) -> int:
        return len(self.corners)

    @property
    def bounds(self) -> tuple[Float[np.ndarray, '3'], Float[np.ndarray, '3']]:
        """Lowest and highest coordinates."""
        points = self.corners.reshape(-1, 3)
        return points.min(axis=0), points.max(axis=0)

    def moved(self, shift: Point, yaw: float = 0.0, scale: Point = (1.0, 1.0, 1.0)) -> 'Mesh':
        """Scaled along its own axes, turned about z (radians), then shifted."""
        c, s = cos_sin(yaw)
        x, y, z = (self.corners[..., i] * scale[i] for i in range(3))
        corners = np.stack([c * x - s * y + shift[0], s * x + c * y + shift[1], z + shift[2]], axis=-1)
        return Mesh(np.round(corners, 6), self.reflectance, self.dropout, self.part)

    def named(self, part: int) -> 'Mesh':
        """The same, every triangle that has no part yet being ``part``."""
        return Mesh(self.corners, self.reflectance, self.dropout, np.where(self.part == 0, part, self.part))


def cos_sin(angle: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cosine and sine rounded to 12 digits: the same on every machine."""
    return np.round(np.cos(angle), 12), np.round(np.sin(angle), 12)


def mesh(corners: Float[np.ndarray, 'faces 3 3'], reflectance: float, dropout: float = 0.0) -> Mesh:
    """Triangles of one material."""
    rounded = np.round(np.asarray(corners, dtype=np.float64), 6)
    return Mesh(rounded, np.full(len(rounded), reflectance), np.full(len(rounded), dropout))


def join(meshes: Sequence[Mesh]) -> Mesh:
    """One mesh of all triangles, in order."""
    if not meshes:
        return mesh(np.zeros((0, 3, 3)), 0.0)
    return Mesh(
        np.concatenate([m.corners for m in meshes]),
        np.concatenate([m.reflectance for m in meshes]),
        np.concatenate([m.dropout for m in meshes]),
        np.concatenate([m.part for m in meshes]),
    )


def quads(points: Float[np.ndarray, 'quads 4 3'], reflectance: float, dropout: float = 0.0) -> Mesh:
    """Two triangles a quadrilateral; corners in a circle."""
    p = np.asarray(points, dtype=np.float64)
    return mesh(np.concatenate([p[:, [0, 1, 2]], p[:, [0, 2, 3]]]), reflectance, dropout)


def grid_quads(grid: Float[np.ndarray, 'rows columns 3']) -> Float[np.ndarray, 'quads 4 3']:
    """The cells of a grid of points."""
    return np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=2).reshape(-1, 4, 3)


def box(center: Point, size: Point, reflectance: float, dropout: float = 0.0, yaw: float = 0.0) -> Mesh:
    """A box turned by yaw about the vertical through its centre."""
    h = np.array([[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]])
    corners = 0.5 * h * np.asarray(size, dtype=np.float64)
    sides = [(0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    return quads(corners[np.array(sides)], reflectance, dropout).moved(center, yaw)


def tube(start: Point, end: Point, radii: tuple[float, float], reflectance: float, sides: int = 7) -> Mesh:
    """A closed cone frustum between two points: limbs, poles, trunks, frames of bicycles."""
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    axis = b - a
    axis = axis / max(float(np.sqrt((axis * axis).sum())), 1e-9)
    helper = np.array([0.0, 1.0, 0.0]) if abs(axis[1]) < 0.7 else np.array([1.0, 0.0, 0.0])
    u = np.cross(axis, helper)
    u = u / np.sqrt((u * u).sum())
    v = np.cross(axis, u)
    c, s = cos_sin(np.arange(sides) * (2 * np.pi / sides))
    circle = c[:, None] * u + s[:, None] * v
    return loft(np.stack([a + radii[0] * circle, b + radii[1] * circle]), reflectance)


def loft(rings: Float[np.ndarray, 'rings points 3'], reflectance: float) -> Mesh:
    """A closed body through rings of as many points, capped at both ends."""
    closed = np.concatenate([rings, rings[:, :1]], axis=1)
    return join([quads(grid_quads(closed), reflectance), _cap(rings[0], reflectance), _cap(rings[-1], reflectance)])


def _cap(ring: Float[np.ndarray, 'points 3'], reflectance: float) -> Mesh:
    middle = np.broadcast_to(ring.sum(axis=0) / len(ring), ring.shape)
    return mesh(np.stack([middle, ring, np.roll(ring, -1, axis=0)], axis=1), reflectance)


def ellipsoid(center: Point, radii: Point, reflectance: float, rows: int = 5, columns: int = 8) -> Mesh:
    """An ellipsoid of latitude rows and longitude columns."""
    lat_c, lat_s = cos_sin((np.arange(rows + 1) / rows - 0.5) * np.pi)
    lon_c, lon_s = cos_sin(np.arange(columns + 1) * (2 * np.pi / columns))
    grid = np.stack(np.broadcast_arrays(lat_c[:, None] * lon_c, lat_c[:, None] * lon_s, lat_s[:, None]), axis=-1)
    return quads(grid_quads(grid * np.asarray(radii) + np.asarray(center)), reflectance)


def leaves(rng: np.random.Generator, center: Point, radii: Point, count: int, size: float, reflectance: float) -> Mesh:
    """Loose triangles that fill an ellipsoid: crowns and bushes, which a beam partly passes.

    Args:
        rng: Source of randomness.
        center: Middle of the ellipsoid.
        radii: Its half axes.
        count: Number of triangles.
        size: Edge length, roughly.
        reflectance: In [0, 1], of a leaf on average; each has its own.
    """
    around = 2 * rng.random((count, 3)) - 1
    length = np.sqrt(around[:, 0] ** 2 + around[:, 1] ** 2 + around[:, 2] ** 2)
    # The corners of the cube go onto the shell, where most leaves are.
    around = around / np.maximum(length, 1.0)[:, None]
    corners = (around * np.asarray(radii) + np.asarray(center))[:, None] + (
        rng.random((count, 3, 3)) - 0.5
    ) * size * 1.6
    return replace(mesh(corners, reflectance), reflectance=reflectance * (0.75 + 0.5 * rng.random(count)))


def disc_ring(center: Point, radius: float, width: float, reflectance: float, sides: int = 14) -> Mesh:
    """A flat ring in the x-z plane: the wheel of a bicycle."""
    c, s = cos_sin(np.arange(sides + 1) * (2 * np.pi / sides))
    rim = np.stack([c, np.zeros(sides + 1), s], axis=1)
    grid = np.stack([rim * radius, rim * (radius - width)]) + np.asarray(center)
    return quads(grid_quads(grid), reflectance)
