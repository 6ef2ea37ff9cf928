"""What a street data set labels: cars, vans, people on foot, sitting and on bicycles, each one different."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from rm3d_plugin.datasets.synthetic.shapes import Mesh, box, cos_sin, disc_ring, ellipsoid, join, loft, mesh, tube

# Stations of a car from its tail to its nose: place along the length (of l), roof height (of h), half width (of w / 2).
_PROFILES = {
    'sedan': [
        (-0.50, 0.40, 0.84), (-0.485, 0.56, 0.93), (-0.45, 0.62, 0.96), (-0.32, 0.66, 1.0), (-0.17, 0.95, 1.0),
        (-0.05, 1.0, 1.0), (0.06, 0.98, 1.0), (0.24, 0.63, 1.0), (0.40, 0.57, 0.96), (0.475, 0.5, 0.88),
        (0.5, 0.36, 0.76),
    ],
    'hatchback': [
        (-0.50, 0.45, 0.86), (-0.48, 0.60, 0.95), (-0.40, 0.90, 0.98), (-0.30, 0.97, 1.0), (-0.05, 1.0, 1.0),
        (0.06, 0.97, 1.0), (0.25, 0.64, 1.0), (0.40, 0.57, 0.95), (0.47, 0.48, 0.87), (0.50, 0.34, 0.74),
    ],
    'suv': [
        (-0.50, 0.48, 0.90), (-0.485, 0.66, 0.97), (-0.45, 0.92, 0.98), (-0.38, 0.98, 1.0), (-0.05, 1.0, 1.0),
        (0.07, 0.97, 1.0), (0.22, 0.66, 1.0), (0.42, 0.60, 0.97), (0.48, 0.52, 0.92), (0.50, 0.36, 0.84),
    ],
    'van': [
        (-0.50, 0.50, 0.94), (-0.495, 0.96, 0.97), (-0.46, 1.0, 1.0), (-0.10, 1.0, 1.0), (0.12, 0.99, 1.0),
        (0.24, 0.94, 1.0), (0.36, 0.62, 0.99), (0.46, 0.52, 0.95), (0.49, 0.44, 0.90), (0.50, 0.28, 0.82),
    ],
}  # fmt: skip
# Mean and spread of (length, width, height) in metres.
_SIZES = {
    'sedan': ((4.35, 1.68, 1.45), (0.24, 0.06, 0.05)),
    'hatchback': ((3.72, 1.60, 1.50), (0.24, 0.06, 0.06)),
    'suv': ((4.15, 1.72, 1.70), (0.22, 0.06, 0.07)),
    'van': ((5.00, 1.90, 2.15), (0.35, 0.08, 0.18)),
}
_BELT = {'sedan': 0.62, 'hatchback': 0.61, 'suv': 0.62, 'van': 0.55}
_GLASS_DROPOUT = 0.85
_PAINTS = (0.04, 0.08, 0.15, 0.3, 0.45, 0.6)
_TYRE = 0.06
_SKIN = 0.45


class RoadUser(NamedTuple):
    """A labelled thing in its own frame: middle of its bottom face at the origin, heading +x.

    Attributes:
        type: KITTI class name.
        size: (length, width, height) in metres, whole centimetres, holding every vertex.
        mesh: Its triangles.
    """

    type: str
    size: tuple[float, float, float]
    mesh: Mesh


def pick(rng: np.random.Generator, low: float, high: float) -> float:
    """A number between two, evenly."""
    return low + (high - low) * float(rng.random())


def vary(rng: np.random.Generator, mean: float, spread: float) -> float:
    """A number near the mean, triangular in mean +- 2 spreads (plain arithmetic only)."""
    return mean + spread * 2.0 * float(rng.random() + rng.random() - 1.0)


def car(rng: np.random.Generator, kind: str) -> RoadUser:
    """A car ('sedan', 'hatchback', 'suv') or a 'van': lofted hull, dark windows, wheels."""
    mean, spread = _SIZES[kind]
    length, width, height = (round(vary(rng, m, s), 2) for m, s in zip(mean, spread, strict=True))
    paint = _PAINTS[int(rng.random() * len(_PAINTS))]
    wheel = pick(rng, 0.29, 0.34)
    parts = [_hull(kind, length, width, height, pick(rng, 0.16, 0.24), paint)]
    for x in (-0.31 * length, 0.32 * length):
        for side in (-1.0, 1.0):
            outer, inner = side * (width / 2 - 0.01), side * (width / 2 - 0.2)
            parts.append(tube((x, inner, wheel), (x, outer, wheel), (wheel, wheel), _TYRE, sides=10))
    for x in (-0.5 * length, 0.5 * length):  # number plates shine back
        parts.append(box((x, 0.0, 0.42), (0.01, 0.5, 0.11), 0.95))
    return RoadUser('Van' if kind == 'van' else 'Car', (length, width, height), join(parts))


def _hull(kind: str, length: float, width: float, height: float, clearance: float, paint: float) -> Mesh:
    x, top, half = (np.array(column) for column in zip(*_PROFILES[kind], strict=True))
    x, top, half = x * length, top * height, half * width / 2
    belt = np.minimum(_BELT[kind] * height, top - 0.02)
    cabin = np.clip((top - belt) / (0.35 * height), 0.0, 1.0)
    roof = half * (1 - 0.2 * cabin)
    sill = np.full(len(x), clearance)
    points = [(half * 0.94, sill), (half, 0.5 * (sill + belt)), (half * 0.985, belt), (roof, top)]
    side = [np.stack([x, y, z], axis=1) for y, z in points]
    ring = np.stack(side + [p * np.array([1.0, -1.0, 1.0]) for p in reversed(side)], axis=1)
    body = loft(ring, paint)
    return _glaze(body, cabin, x[:-1] > (0.05 * length if kind == 'van' else -length))


def _glaze(body: Mesh, cabin: Float[np.ndarray, ' stations'], windows: Bool[np.ndarray, ' gaps']) -> Mesh:
    """Turn the side windows (where there may be any) and the steep parts of a lofted hull's roof line into glass."""
    quads_of_ring = 8
    cells = (len(cabin) - 1) * quads_of_ring
    station, column = np.divmod(np.arange(cells), quads_of_ring)
    high = np.minimum(cabin[station], cabin[station + 1])
    side = ((column == 2) | (column == 4)) & (np.maximum(cabin[station], cabin[station + 1]) > 0.5)
    side &= windows[station]
    screen = (column == 3) & (np.abs(cabin[station] - cabin[station + 1]) > 0.25) & (high < 0.8)
    glass = np.zeros(len(body), dtype=bool)
    glass[: 2 * cells] = np.tile(side | screen, 2)
    return Mesh(body.corners, np.where(glass, 0.08, body.reflectance), np.where(glass, _GLASS_DROPOUT, body.dropout))


def pedestrian(rng: np.random.Generator) -> RoadUser:
    """Someone who stands or walks, arms and legs apart; some carry a bag."""
    height = vary(rng, 1.72, 0.07) if rng.random() < 0.88 else vary(rng, 1.25, 0.12)
    step = pick(rng, 0.2, 0.42) if rng.random() < 0.65 else pick(rng, 0.0, 0.08)
    coat, trousers = pick(rng, 0.08, 0.75), pick(rng, 0.05, 0.6)
    broad = vary(rng, 1.12, 0.08)
    hip, shoulder = 0.5 * height, 0.8 * height
    parts = [_head(0.02, 0.93 * height), _torso((0.0, hip), (0.02, shoulder), broad, coat)]
    for side in (-1.0, 1.0):
        reach = side * step
        knee = (0.5 * reach + 0.03, side * 0.09 * broad, 0.28 * height)
        foot = (reach, side * 0.1 * broad, 0.05)
        parts += [tube((0, side * 0.09 * broad, hip), knee, (0.105, 0.08), trousers)]
        parts += [
            tube(knee, foot, (0.075, 0.06), trousers),
            box((foot[0] + 0.06, foot[1], 0.04), (0.26, 0.09, 0.08), 0.1),
        ]
        spread = side * pick(rng, 0.2, 0.27) * broad
        elbow = (-0.45 * reach, spread, 0.63 * height)
        hand = (-0.8 * reach + pick(rng, 0.0, 0.16), spread, 0.49 * height)
        parts += [tube((0.0, side * 0.19 * broad, shoulder - 0.03), elbow, (0.075, 0.065), coat)]
        parts += [tube(elbow, hand, (0.06, 0.05), coat)]
    if rng.random() < 0.3:
        parts.append(box((-0.2, 0.0, 0.68 * height), (0.16, 0.3, 0.42), pick(rng, 0.05, 0.5)))
    if rng.random() < 0.15:
        parts.append(box((0.1, 0.36, 0.33 * height), (0.35, 0.14, 0.32), pick(rng, 0.05, 0.5)))
    return fitted('Pedestrian', join(parts))


def sitting_person(rng: np.random.Generator) -> RoadUser:
    """Someone on a bench (the bench is not part of it)."""
    coat, trousers = pick(rng, 0.08, 0.7), pick(rng, 0.05, 0.6)
    parts = [_head(-0.08, 1.18), _torso((-0.15, 0.5), (-0.1, 1.02), 1.0, coat)]
    for side in (-0.11, 0.11):
        knee = (0.32, side, 0.52)
        parts += [
            tube((-0.12, side, 0.52), knee, (0.105, 0.08), trousers),
            tube(knee, (0.36, side, 0.03), (0.075, 0.06), trousers),
        ]
        parts += [tube((-0.1, side * 2, 0.98), (0.0, side * 2.3, 0.7), (0.075, 0.065), coat)]
        parts += [tube((0.0, side * 2.3, 0.7), (0.25, side, 0.62), (0.06, 0.05), coat)]
    return fitted('Person_sitting', join(parts))


def cyclist(rng: np.random.Generator) -> RoadUser:
    """A rider on a bicycle, legs anywhere in the turn of the pedals."""
    coat, trousers, lean = pick(rng, 0.1, 0.75), pick(rng, 0.05, 0.6), pick(rng, 0.12, 0.42)
    size = vary(rng, 1.0, 0.03)
    saddle, shoulder = (-0.24, 0.92), (-0.2 + lean, 1.46 - 0.25 * lean)
    parts = [
        bicycle(rng),
        _torso((saddle[0], saddle[1]), shoulder, 0.95, coat),
        _head(shoulder[0] + 0.06, shoulder[1] + 0.22),
    ]
    turn = pick(rng, 0.0, 2 * np.pi)
    for side in (-1.0, 1.0):
        c, s = (float(v) for v in cos_sin(turn + (np.pi if side > 0 else 0.0)))
        foot = (-0.05 + 0.17 * c, side * 0.13, 0.29 + 0.17 * s)
        knee = (0.22 + 0.08 * c, side * 0.14, 0.66 + 0.1 * s)
        parts += [tube((saddle[0], side * 0.1, saddle[1]), knee, (0.105, 0.08), trousers)]
        parts += [
            tube(knee, foot, (0.075, 0.06), trousers),
            box((foot[0] + 0.05, foot[1], foot[2] - 0.04), (0.25, 0.09, 0.08), 0.1),
        ]
        hand = (0.42, side * 0.2, 1.03)
        elbow = (0.5 * (hand[0] + shoulder[0]) - 0.06, side * 0.22, 0.5 * (hand[2] + shoulder[1]) - 0.08)
        parts += [tube((shoulder[0], side * 0.17, shoulder[1] - 0.04), elbow, (0.075, 0.065), coat)]
        parts += [tube(elbow, hand, (0.06, 0.05), coat)]
    body = join(parts)
    return fitted('Cyclist', body.moved((0.0, 0.0, 0.0), scale=(size, 1.0, size)))


def bicycle(rng: np.random.Generator) -> Mesh:
    """A bicycle without its rider, 1.7 m long."""
    steel, radius = pick(rng, 0.2, 0.6), 0.34
    rear, front, crank, seat, steer = (
        (-0.52, 0.0, 0.34),
        (0.52, 0.0, 0.34),
        (-0.05, 0, 0.3),
        (-0.23, 0, 0.9),
        (0.38, 0, 0.98),
    )
    bars = [(rear, crank), (rear, seat), (crank, seat), (crank, steer), (seat, (0.36, 0.0, 0.8)), (steer, front)]
    parts = [tube(a, b, (0.022, 0.022), steel, sides=4) for a, b in bars]
    parts += [disc_ring(hub, radius, 0.06, 0.15) for hub in (rear, front)]
    parts += [tube((h[0], -0.02, h[2]), (h[0], 0.02, h[2]), (0.06, 0.06), steel, sides=5) for h in (rear, front)]
    for hub in (rear, front):
        c, s = cos_sin(np.arange(6) * (np.pi / 3) + 0.3)
        rim = np.stack([c * radius, np.zeros(6), s * radius], axis=1) + np.asarray(hub)
        thick = np.stack([-s * 0.008, np.zeros(6), c * 0.008], axis=1)
        middle = np.broadcast_to(np.asarray(hub), rim.shape)
        parts.append(mesh(np.stack([middle, rim + thick, rim - thick], axis=1), 0.4))
    parts.append(tube((0.4, -0.25, 1.02), (0.4, 0.25, 1.02), (0.02, 0.02), steel, sides=4))
    parts.append(box((-0.24, 0.0, 0.93), (0.26, 0.14, 0.06), 0.1))
    return join(parts)


def fitted(kind: str, body: Mesh, margin: float = 0.02) -> RoadUser:
    """Centre a body over the origin, feet on the ground, and give it the box that holds it, in whole centimetres."""
    low, high = body.bounds
    length, width, height = (
        float(np.ceil(v * 100) / 100) for v in high - low + np.array([2 * margin, 2 * margin, margin])
    )
    middle = 0.5 * (low + high)
    size = (round(max(length, 0.6), 2), round(max(width, 0.5), 2), round(height, 2))
    return RoadUser(kind, size, body.moved((-float(middle[0]), -float(middle[1]), -float(low[2]))))


def _head(x: float, z: float) -> Mesh:
    return ellipsoid((x, 0.0, z), (0.115, 0.1, 0.135), _SKIN)


def _torso(low: tuple[float, float], high: tuple[float, float], broad: float, coat: float) -> Mesh:
    """Elliptic sections from hip (x, z) to shoulder (x, z)."""
    c, s = cos_sin(np.arange(9) * (2 * np.pi / 9))
    rings = []
    for share, deep, wide in (
        (-0.08, 0.1, 0.15),
        (0.2, 0.12, 0.165),
        (0.75, 0.13, 0.2),
        (1.0, 0.09, 0.19),
        (1.1, 0.05, 0.07),
    ):
        x, z = low[0] + share * (high[0] - low[0]), low[1] + share * (high[1] - low[1])
        rings.append(np.stack([x + deep * c, wide * broad * s, np.full(9, z)], axis=1))
    return loft(np.stack(rings), coat)
