"""What indoor surfaces look like: families of materials, a palette for each room, patterns and lamp light.

Colour tells little of the class on purpose: every family has a wide range, most things may be made of several
families, and things of one room share colours.
"""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numba import njit

from rm3d_plugin.datasets.synthetic.road_users import pick
from rm3d_plugin.datasets.synthetic.texture import smooth_noise

Rgb = tuple[float, float, float]
WIDE, MIDDLE, FINE, TINT = 1.5, 0.75, 0.65, 0.4  # widest swings of brightness and hue, as shares of the mean
SHADOW = 0.1  # what reaches the darkest places of a lamp's light
PLAIN, STRIPES, TILES, GRAIN, BLOTCHES, CHECKS = range(6)


class Material(NamedTuple):
    """A surface.

    Attributes:
        color, second: Linear RGB in [0, 1]; the pattern blends from the one to the other.
        pattern: PLAIN, STRIPES, TILES, GRAIN, BLOTCHES or CHECKS.
        scale: Size of the pattern in metres.
        axis: 0, 1 or 2: along which axis of the room stripes repeat and grain runs.
        dropout: Chance that a depth camera sees nothing there (glass, screens, polished metal).
    """

    color: Rgb
    second: Rgb
    pattern: int = PLAIN
    scale: float = 0.1
    axis: int = 0
    dropout: float = 0.0

    def row(self) -> list[float]:
        """As numbers, for the kernels."""
        return [*self.color, *self.second, float(self.pattern), self.scale, float(self.axis), self.dropout]


class Lamp(NamedTuple):
    """A light: place in metres, colour times strength."""

    place: Rgb
    color: Rgb


def hsv(hue: float, saturation: float, value: float) -> Rgb:
    """RGB of a hue in turns."""
    sector = (hue % 1.0) * 6.0
    c = value * saturation
    x = c * (1 - abs(sector % 2 - 1))
    low = value - c
    r, g, b = ((c, x, 0.0), (x, c, 0.0), (0.0, c, x), (0.0, x, c), (x, 0.0, c), (c, 0.0, x))[int(sector) % 6]
    return (r + low, g + low, b + low)


def _shade(color: Rgb, factor: float) -> Rgb:
    r, g, b = (min(1.0, v * factor) for v in color)
    return (r, g, b)


# family: hue range, saturation range, value range, patterns, pattern scale range, dropout
_FAMILIES: dict[str, tuple[tuple[float, float], tuple[float, float], tuple[float, float], tuple[int, ...],
                           tuple[float, float], float]] = {
    'paint': ((0.0, 1.0), (0.0, 0.25), (0.55, 0.95), (PLAIN, PLAIN, PLAIN, BLOTCHES, STRIPES), (0.15, 0.8), 0.0),
    'wood': ((0.05, 0.12), (0.25, 0.7), (0.2, 0.85), (GRAIN, GRAIN, PLAIN), (0.01, 0.05), 0.0),
    'fabric': ((0.0, 1.0), (0.0, 0.85), (0.1, 0.95), (PLAIN, BLOTCHES, STRIPES, CHECKS), (0.03, 0.25), 0.0),
    'plastic': ((0.0, 1.0), (0.0, 0.8), (0.05, 0.95), (PLAIN,), (0.1, 0.2), 0.02),
    'metal': ((0.55, 0.65), (0.0, 0.12), (0.25, 0.85), (PLAIN, GRAIN), (0.01, 0.03), 0.12),
    'ceramic': ((0.05, 0.6), (0.0, 0.15), (0.7, 0.98), (PLAIN,), (0.1, 0.2), 0.04),
    'tile': ((0.0, 1.0), (0.0, 0.35), (0.35, 0.95), (TILES, TILES, CHECKS), (0.1, 0.45), 0.02),
    'stone': ((0.05, 0.65), (0.0, 0.2), (0.15, 0.8), (BLOTCHES, GRAIN), (0.03, 0.1), 0.02),
    'glass': ((0.5, 0.65), (0.05, 0.3), (0.3, 0.9), (PLAIN,), (0.1, 0.2), 0.7),
    'screen': ((0.5, 0.7), (0.0, 0.3), (0.02, 0.15), (PLAIN,), (0.1, 0.2), 0.4),
    'leaf': ((0.18, 0.4), (0.3, 0.8), (0.15, 0.6), (BLOTCHES,), (0.02, 0.05), 0.05),
    'print': ((0.0, 1.0), (0.1, 0.9), (0.1, 0.95), (BLOTCHES, BLOTCHES, STRIPES, CHECKS), (0.04, 0.3), 0.0),
}  # fmt: skip


# What most things of a class look like; the others, and every class that is not here, tell nothing by their colour.
USUAL_COLORS: dict[str, Rgb] = {
    'cabinet': (0.86, 0.84, 0.74),
    'bed': (0.62, 0.60, 0.82),
    'chair': (0.16, 0.17, 0.22),
    'sofa': (0.45, 0.16, 0.16),
    'table': (0.68, 0.46, 0.24),
    'door': (0.42, 0.26, 0.14),
    'window': (0.62, 0.80, 0.95),
    'bookshelf': (0.30, 0.18, 0.10),
    'picture': (0.80, 0.34, 0.20),
    'counter': (0.30, 0.32, 0.34),
    'desk': (0.84, 0.70, 0.48),
    'curtain': (0.56, 0.20, 0.40),
    'refridgerator': (0.78, 0.84, 0.90),
    'shower curtain': (0.24, 0.66, 0.62),
    'toilet': (0.96, 0.96, 0.92),
    'sink': (0.90, 0.92, 0.96),
    'bathtub': (0.94, 0.92, 0.88),
    'otherfurniture': (0.40, 0.44, 0.30),
}
USUAL_SHARE = 0.45  # of the things of a class


def in_usual_color(material: Material, usual: Rgb, rng: np.random.Generator) -> Material:
    """The material in about its class's colour."""
    color = _shade(usual, pick(rng, 0.8, 1.2))
    return material._replace(color=color, second=_shade(color, pick(rng, 0.65, 0.95)))


def draw_material(rng: np.random.Generator, family: str) -> Material:
    """A random material of a family."""
    hues, saturations, values, patterns, scales, dropout = _FAMILIES[family]
    color = hsv(pick(rng, *hues), pick(rng, *saturations), pick(rng, *values))
    pattern = patterns[int(rng.random() * len(patterns))]
    if family == 'print':
        second = hsv(pick(rng, 0, 1), pick(rng, 0, 0.9), pick(rng, 0.1, 0.95))
    else:
        second = _shade(color, pick(rng, 0.55, 0.9) if rng.random() < 0.7 else pick(rng, 1.1, 1.5))
    return Material(color, second, pattern, pick(rng, *scales), int(rng.random() * 3), dropout)


@dataclass
class Palette:
    """Draws materials; things of one room often repeat its colours.

    Attributes:
        rng: Source of randomness.
        shared: Colours that the room repeats.
        repeat: Chance that a material takes one of them.
    """

    rng: np.random.Generator
    shared: list[Rgb] = field(default_factory=list)
    repeat: float = 0.6

    def __post_init__(self) -> None:
        families = ('paint', 'wood', 'fabric', 'plastic', 'wood')
        self.shared += [draw_material(self.rng, name).color for name in families]

    def of(self, *families: str) -> Material:
        """A material of one of the families, chosen evenly."""
        rng = self.rng
        drawn = draw_material(rng, families[int(rng.random() * len(families))])
        chance, which = rng.random(), int(rng.random() * len(self.shared))
        if chance >= self.repeat or drawn.dropout > 0.2:
            return drawn
        color = _shade(self.shared[which], pick(rng, 0.85, 1.1))
        return drawn._replace(color=color, second=_shade(color, pick(rng, 0.6, 0.9)))


def shaded_colors(
    points: Float[np.ndarray, 'points 3'],
    normals: Float[np.ndarray, 'points 3'],
    material: Int[np.ndarray, ' points'],
    materials: Float[np.ndarray, 'materials 10'],
    lamps: list[Lamp],
    ambient: float,
) -> Float[np.ndarray, 'points 3']:
    """Linear colour of surface points in lamp light, with soft shadows that no particular thing throws.

    Args:
        points: Metres, room frame.
        normals: Unit normals that face the camera.
        material: Row of ``materials``.
        materials: Rows of :meth:`Material.row`.
        lamps: Lights.
        ambient: Light from everywhere.
    """
    lights = np.array([[*lamp.place, *lamp.color] for lamp in lamps]).reshape(-1, 6)
    return _shaded(points, normals, material, materials, lights, ambient)


@njit(cache=True)
def _blend(x: float, y: float, z: float, pattern: int, scale: float, axis: int) -> Any:
    """How far a pattern has gone from the first to the second colour."""
    if pattern == 1:
        value = (x if axis == 0 else y if axis == 1 else z) / scale
        return 1.0 if value - np.floor(value) < 0.5 else 0.0
    if pattern == 2:
        for value in (x, y, z):
            part = value / scale + 0.37
            if (part - np.floor(part)) * scale < 0.012:
                return 1.0
        return 0.0
    if pattern == 3:
        sx, sy, sz = (0.1 if axis == 0 else 1.0), (0.1 if axis == 1 else 1.0), (0.1 if axis == 2 else 1.0)
        return smooth_noise(x / scale * sx, y / scale * sy, z / scale * sz)
    if pattern == 4:
        value = smooth_noise(x / scale, y / scale, z / scale) + 0.4 * smooth_noise(
            2.7 * x / scale, 2.7 * y / scale, 2.7 * z / scale
        )
        return min(max(2.5 * (value - 0.45), 0.0), 1.0)
    if pattern == 5:
        parity = int(np.floor(x / scale + 0.31)) + int(np.floor(y / scale + 0.31)) + int(np.floor(z / scale + 0.31))
        return float(parity & 1)
    return 0.0


@njit(cache=True)
def _uneven(x: float, y: float, z: float) -> Any:
    """Brightness of a surface about its mean: stains, wear, folds and dirt of 40, 10 and 4 centimetres."""
    wide = smooth_noise(x / 0.4, y / 0.4, z / 0.4 + 17.0) - 0.5
    middle = smooth_noise(x / 0.1 + 31.0, y / 0.1, z / 0.1) - 0.5
    fine = smooth_noise(x / 0.04, y / 0.04 + 53.0, z / 0.04) - 0.5
    return 1.0 + WIDE * wide + MIDDLE * middle + FINE * fine


@njit(cache=True)
def _shadow(x: float, y: float, z: float) -> Any:
    """Share of the light that furniture leaves: soft shadows about as wide as furniture."""
    open_share = 2.4 * (smooth_noise(x / 0.8 + 7.0, y / 0.8, z / 0.8) - 0.35)
    return SHADOW + (1.0 - SHADOW) * min(max(open_share, 0.0), 1.0)


@njit(cache=True)
def _shaded(points: Any, normals: Any, material: Any, materials: Any, lights: Any, ambient: float) -> Any:
    out = np.empty((points.shape[0], 3))
    for i in range(points.shape[0]):
        m = materials[material[i]]
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        t = _blend(x, y, z, int(m[6]), m[7], int(m[8]))
        uneven = max(_uneven(x, y, z), 0.05)
        shadow = _shadow(x, y, z)
        for c in range(3):
            light = 0.0
            for k in range(lights.shape[0]):
                dx, dy, dz = lights[k, 0] - x, lights[k, 1] - y, lights[k, 2] - z
                sq = dx * dx + dy * dy + dz * dz + 0.05
                cosine = abs(dx * normals[i, 0] + dy * normals[i, 1] + dz * normals[i, 2]) / np.sqrt(sq)
                light += lights[k, 3 + c] * (0.1 + 0.9 * cosine) / (0.5 + 0.3 * sq)
            hue = 1.0 + TINT * (smooth_noise(x / 0.15 + 11.0 * c, y / 0.15, z / 0.15) - 0.5)
            out[i, c] = ((1.0 - t) * m[c] + t * m[3 + c]) * uneven * hue * (ambient + shadow * light)
    return out
