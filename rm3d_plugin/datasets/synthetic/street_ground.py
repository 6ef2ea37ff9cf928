"""The ground of a synthetic street: its shape, and the surfaces of road, parking strips, pavements and land."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rm3d_plugin.datasets.synthetic.parts import Part
from rm3d_plugin.datasets.synthetic.road_users import pick
from rm3d_plugin.datasets.synthetic.shapes import Mesh, cos_sin, grid_quads, quads

SENSOR_HEIGHT = 1.73  # m above the road; KITTI's Velodyne
PARKING = 2.2  # m, width of the strip where cars park
BEHIND, AHEAD = -62.0, 80.0  # m along the road
_LAND = np.array([1.5, 3.5, 6.0, 9.0, 14.0, 20.0, 28.0, 50.0])  # m beyond the pavement
_MENDED, _FRESH = 0.18, 0.35  # share of the road that was mended, and how bright that is beside the rest
_ROUGH_ROAD, _ROUGH_LAND = 0.008, 0.07  # m, half width


@dataclass(frozen=True)
class Road:
    """Shape of the ground; offsets are metres to the left of the sensor's path.

    Attributes:
        left, right: Kerbs (right is negative).
        pavement: Width of the pavements.
        bend: Half the curvature, 1 / m: the road runs through y = offset + bend x^2.
        slope, camber: Rise along and across, m / m.
        wave: Height in metres, frequency in radians a metre and phase of an undulation.
        parked_left, parked_right: Whether cars park along that kerb.
        kerb: Its height in metres; most kerbs of real streets are low (2 to 8 cm as scanned).
        verge: Width of the land between pavement and gardens.
    """

    left: float
    right: float
    pavement: float
    bend: float
    slope: float
    camber: float
    wave: tuple[float, float, float]
    parked_left: bool
    parked_right: bool
    kerb: float = 0.05
    verge: float = 0.3

    def point(self, x: float, offset: float) -> tuple[float, float]:
        """Plan position of a place on the road."""
        return x, offset + self.bend * x * x

    def heading(self, x: float) -> float:
        """Radians counter-clockwise from +x."""
        return float(np.round(np.arctan(2 * self.bend * x), 9))

    def height(self, x: float | np.ndarray, offset: float | np.ndarray) -> np.ndarray:
        """Ground z in the sensor frame, kerbs included."""
        size, frequency, phase = self.wave
        swing = cos_sin(frequency * np.asarray(x) + phase)[1] - cos_sin(phase)[1]
        off = np.asarray(offset)
        step = np.where((off > self.left) | (off < self.right), self.kerb, 0.0)
        return -SENSOR_HEIGHT + self.slope * np.asarray(x) + self.camber * off + size * swing + step


def random_road(rng: np.random.Generator) -> Road:
    """A gently curved road with kerbs, and cars parked on one side, both or none."""
    parked_right = bool(rng.random() < 0.7)
    parked_left = not parked_right or bool(rng.random() < 0.45)
    left = pick(rng, 4.4, 6.2) + (PARKING if parked_left else 0.0)
    right = -pick(rng, 2.4, 3.4) - (PARKING if parked_right else 0.0)
    wave = (pick(rng, 0.0, 0.12), pick(rng, 0.1, 0.28), pick(rng, 0.0, 2 * np.pi))
    bend = pick(rng, -0.0016, 0.0016)
    slope, camber = pick(rng, -0.012, 0.012), pick(rng, -0.012, 0.012)
    pavement, kerb, verge = pick(rng, 1.8, 4.0), pick(rng, 0.03, 0.07), pick(rng, 0.5, 3.5)
    return Road(left, right, pavement, bend, slope, camber, wave, parked_left, parked_right, kerb, verge)


def make_ground(road: Road, rng: np.random.Generator) -> Mesh:
    """Road, parking strips, kerbs, pavements and land: a grid along the road, the land rougher.

    Reflectances of pavements, parking strips and land overlap, as measured; the asphalt of the lanes is darker.
    """
    x = np.arange(BEHIND - 20, AHEAD + 4, 2.0)
    strips = [road.left - PARKING if road.parked_left else road.left - 0.3]
    strips.append(road.right + PARKING if road.parked_right else road.right + 0.3)
    lane = np.concatenate([[road.right], np.linspace(strips[1], strips[0], 4), [road.left]])
    outer_left, outer_right = road.left + road.pavement, road.right - road.pavement
    offset = np.concatenate(
        [outer_right - _LAND[::-1], [outer_right, road.right - 1e-6], lane, [road.left + 1e-6, outer_left],
         outer_left + _LAND]
    )  # fmt: skip
    edges = len(_LAND)
    stone, asphalt, grass = pick(rng, 0.41, 0.43), pick(rng, 0.345, 0.365), pick(rng, 0.42, 0.46)
    beside = [stone if road.parked_right else asphalt, stone if road.parked_left else asphalt]
    flags = 0.98 * stone
    shades = [grass, flags, beside[0], asphalt, beside[1], flags, grass]
    reflectance = np.repeat(shades, [edges, 2, 1, len(lane) - 3, 1, 2, edges])
    rough = np.repeat([_ROUGH_LAND, _ROUGH_ROAD, _ROUGH_LAND], [edges, len(lane) + 4, edges])
    grid_x, grid_offset = np.broadcast_arrays(x[:, None], offset[None])
    z = road.height(grid_x, grid_offset) + rough * (2 * rng.random(grid_x.shape) - 1)
    grid: Float[np.ndarray, 'rows columns 3'] = np.stack(
        [grid_x, grid_offset + road.bend * grid_x * grid_x, z], axis=-1
    )
    surface = quads(grid_quads(grid), 0.3)
    kinds = [Part.TERRAIN, Part.SIDEWALK, Part.ROAD, Part.SIDEWALK, Part.TERRAIN]
    part = np.repeat(kinds, [edges, 2, len(lane) - 1, 2, edges])
    cells, kind = np.tile(reflectance, len(x) - 1), np.tile(part, len(x) - 1)
    mended = (cells == asphalt) & (rng.random(len(cells)) < _MENDED)
    cells = np.where(mended, _FRESH * cells, cells)
    return Mesh(surface.corners, np.tile(cells, 2), surface.dropout, np.tile(kind, 2))
