"""What stands in a street and is not labelled: facades, trees, poles, and things as large as a person or a car."""

import numpy as np

from rm3d_plugin.datasets.synthetic.parts import Part
from rm3d_plugin.datasets.synthetic.road_users import bicycle, pick, vary
from rm3d_plugin.datasets.synthetic.shapes import Mesh, box, ellipsoid, join, leaves, quads, tube

_GREEN = 0.45
_GLASS = (0.1, 0.8)  # reflectance, drop-out


def tree(rng: np.random.Generator) -> Mesh:
    """A trunk and a crown of a few leafy clumps, 3 to 9 m high; the crowns of some hang low."""
    height, trunk = pick(rng, 3.0, 9.0), pick(rng, 0.06, 0.2)
    base, bark = pick(rng, 0.2, 2.2), pick(rng, 0.36, 0.5)
    parts = [
        tube(
            (0, 0, -0.3), (pick(rng, -0.3, 0.3), pick(rng, -0.3, 0.3), base + 0.8), (trunk, trunk * 0.75), bark, 8
        ).named(Part.TRUNK)
    ]
    for i in range(3 + int(rng.random() * 3)):
        wide = pick(rng, 0.8, 1.7)
        top = base + 0.9 if i == 0 else max(height - 0.8, base + 1.0)
        center = (pick(rng, -1, 1), pick(rng, -1, 1), pick(rng, base + 0.7, top))
        parts.append(leaves(rng, center, (wide, wide, wide * 0.8), int(130 * wide), 0.4, _GREEN))
    return join(parts).named(Part.CROWN)


def bush(rng: np.random.Generator) -> Mesh:
    """A leafy ball: often as high as a person, sometimes as long as a car."""
    long, wide, high = pick(rng, 0.4, 1.6), pick(rng, 0.4, 1.1), pick(rng, 0.4, 1.2)
    clump = leaves(rng, (0, 0, high * 0.9), (long, wide, high), int(200 * long * (wide + high)), 0.22, _GREEN)
    core = ellipsoid((0, 0, high * 0.85), (long * 0.6, wide * 0.6, high * 0.75), _GREEN)
    return join([clump, core]).named(Part.VEGETATION)


def hedge(rng: np.random.Generator, length: float) -> Mesh:
    """A cut hedge along x, 1 to 2.3 m high."""
    high, wide = pick(rng, 1.0, 2.3), pick(rng, 0.5, 0.9)
    core = box((0, 0, high / 2 - 0.05), (length, wide * 0.7, high - 0.1), _GREEN)
    cover = (2 * rng.random((int(70 * length * high), 1, 3)) - 1) * np.array([length, wide, high]) / 2
    spread = (rng.random((len(cover), 3, 3)) - 0.5) * 0.3
    corners = cover + spread + np.array([0, 0, high / 2])
    return join(
        [core, Mesh(np.round(corners, 6), _GREEN * (0.75 + 0.5 * rng.random(len(corners))), np.zeros(len(corners)))]
    ).named(Part.VEGETATION)


def thicket(rng: np.random.Generator, length: float) -> Mesh:
    """The edge of a wood or an overgrown slope along x, 2.5 to 6 m high."""
    high, wide = pick(rng, 2.5, 6.0), pick(rng, 1.5, 4.0)
    parts = []
    for x in np.arange(-length / 2, length / 2, 2.2):
        center = (float(x), pick(rng, -0.8, 0.8), high * pick(rng, 0.4, 0.55))
        parts.append(leaves(rng, center, (1.6, wide / 2, high / 2), int(34 * high), 0.6, _GREEN))
    return join(parts).named(Part.VEGETATION)


def wall(rng: np.random.Generator, length: float) -> Mesh:
    """A garden wall along x."""
    high = pick(rng, 0.6, 1.9)
    return box((0, 0, high / 2 - 0.15), (length, 0.22, high + 0.3), pick(rng, 0.34, 0.5)).named(Part.WALL)


def fence(rng: np.random.Generator, length: float) -> Mesh:
    """Posts, two rails and slats with gaps, along x."""
    high, gap, paint = pick(rng, 0.9, 1.6), pick(rng, 0.16, 0.3), pick(rng, 0.34, 0.5)
    slats = np.arange(-length / 2, length / 2, gap)
    half = gap * pick(rng, 0.2, 0.4)
    low, top = np.full(len(slats), 0.08), np.full(len(slats), high)
    zero = np.zeros(len(slats))
    corners = [
        (slats - half, zero, low),
        (slats + half, zero, low),
        (slats + half, zero, top),
        (slats - half, zero, top),
    ]
    parts = [quads(np.stack([np.stack(c, axis=1) for c in corners], axis=1), paint)]
    parts += [box((0, 0.03, z), (length, 0.04, 0.08), paint) for z in (0.25, high - 0.15)]
    return join(parts).named(Part.FENCE)


def facade(rng: np.random.Generator, length: float) -> Mesh:
    """A house front along x that faces -y: windows, a door, sometimes bays and balconies."""
    high, paint = pick(rng, 3.5, 12.0), pick(rng, 0.45, 0.6)
    parts = [box((0, 2.0, high / 2 - 0.3), (length, 4.0, high + 0.6), paint)]
    step = pick(rng, 2.2, 3.4)
    bays = rng.random() < 0.4
    balconies = rng.random() < 0.35
    for x in np.arange(-length / 2 + step / 2, length / 2 - 0.8, step):
        for z in np.arange(1.7, high - 0.8, 2.9):
            parts.append(box((x, -0.005, z), (1.1, 0.05, 1.4), *_GLASS))
            parts.append(box((x, -0.05, z - 0.78), (1.3, 0.14, 0.08), paint))
            if balconies and z > 3 and rng.random() < 0.5:
                parts.append(box((x, -0.6, z - 0.9), (2.0, 1.2, 0.12), paint))
                parts.append(box((x, -1.18, z - 0.45), (2.0, 0.04, 0.9), 0.3))
        if bays and rng.random() < 0.4:
            parts.append(box((x, -0.4, high / 3), (1.6, 0.9, high / 1.5), paint))
    if rng.random() < 0.7:
        parts.append(box((pick(rng, -length / 3, length / 3), -0.03, 1.0), (1.0, 0.12, 2.1), pick(rng, 0.1, 0.5)))
        parts.append(box((pick(rng, -length / 3, length / 3), -0.5, 0.1), (1.4, 0.9, 0.5), paint))
    return join(parts).named(Part.BUILDING)


def small_thing(rng: np.random.Generator) -> Mesh:
    """Something of the size of a person or a cyclist that is neither."""
    makers = (_bin, _bollard, _cabinet, _column, _parked_bicycle, _sign, _pole, bush, _hydrant, _planter, _bin, _sign)
    return makers[int(rng.random() * len(makers))](rng)


def big_thing(rng: np.random.Generator) -> Mesh:
    """Something of the size of a car that is none: container, stack, trailer, long bush."""
    kind = int(rng.random() * 4)
    length, width, high = vary(rng, 3.2, 0.5), vary(rng, 1.6, 0.15), vary(rng, 1.4, 0.2)
    if kind == 0:
        return join(
            [box((0, 0, high / 2), (length, width, high), 0.3), box((0, 0, high), (length + 0.2, 0.1, 0.1), 0.3)]
        )
    if kind == 1:
        slabs = [(pick(rng, -0.2, 0.2), 0.15 + 0.3 * i, pick(rng, 0.6, 1.0)) for i in range(4)]
        return join([box((x, 0, z), (length * share, width * share, 0.24), 0.4) for x, z, share in slabs])
    if kind == 2:
        wheels = [tube((0, s * 0.7, 0.3), (0, s * 0.9, 0.3), (0.3, 0.3), 0.06) for s in (-1, 1)]
        return join(
            [
                box((0, 0, 0.75), (length * 0.8, 1.4, 0.6), 0.35),
                tube((1.2, 0, 0.5), (2, 0, 0.5), (0.05, 0.05), 0.3),
                *wheels,
            ]
        ).named(Part.TRAILER)
    clump = leaves(rng, (0, 0, high * 0.5), (length / 2, width / 2, high * 0.6), 500, 0.25, _GREEN)
    return join([clump, ellipsoid((0, 0, high * 0.45), (length * 0.35, width * 0.35, high * 0.45), _GREEN)]).named(
        Part.VEGETATION
    )


def bench(rng: np.random.Generator) -> Mesh:
    """A bench that faces +x."""
    wide = pick(rng, 1.4, 2.0)
    legs = [box((-0.05, y, 0.22), (0.4, 0.08, 0.44), 0.3) for y in (-wide / 2 + 0.2, wide / 2 - 0.2)]
    return join(
        [box((-0.05, 0, 0.45), (0.45, wide, 0.05), 0.35), box((-0.3, 0, 0.72), (0.05, wide, 0.35), 0.35), *legs]
    )


def _bin(rng: np.random.Generator) -> Mesh:
    radius, high = pick(rng, 0.2, 0.35), pick(rng, 0.8, 1.25)
    if rng.random() < 0.5:
        return tube((0, 0, 0), (0, 0, high), (radius * 0.85, radius), 0.25, 9)
    return join([box((0, 0, high / 2), (0.55, 0.6, high), 0.15), box((0, 0, high), (0.6, 0.65, 0.07), 0.15)])


def _bollard(rng: np.random.Generator) -> Mesh:
    return tube((0, 0, 0), (0, 0, pick(rng, 0.7, 1.1)), (0.08, 0.06), 0.36).named(Part.POLE)


def _cabinet(rng: np.random.Generator) -> Mesh:
    return box((0, 0, 0.65), (pick(rng, 0.6, 1.4), pick(rng, 0.3, 0.45), pick(rng, 1.1, 1.5)), 0.4)


def _column(rng: np.random.Generator) -> Mesh:
    high = pick(rng, 1.8, 2.8)
    return tube((0, 0, 0), (0, 0, high), (pick(rng, 0.3, 0.6), 0.4), 0.4, 12)


def _parked_bicycle(rng: np.random.Generator) -> Mesh:
    stand = tube((0.1, 0.3, 0), (0.1, 0.3, 0.85), (0.03, 0.03), 0.4)
    return join([bicycle(rng), stand]).named(Part.BICYCLE)


def _sign(rng: np.random.Generator) -> Mesh:
    high, half = pick(rng, 1.9, 2.8), pick(rng, 0.25, 0.4)
    board = box((0.06, 0, high - half), (0.02, 2 * half, 2 * half), 0.95).named(Part.SIGN)
    return join([tube((0, 0, 0), (0, 0, high), (0.035, 0.035), 0.3, 6), board]).named(Part.POLE)


def _pole(rng: np.random.Generator) -> Mesh:
    high = pick(rng, 4.0, 8.0)
    parts = [tube((0, 0, 0), (0, 0, high), (pick(rng, 0.05, 0.1), 0.05), 0.36, 8)]
    if rng.random() < 0.4:
        parts.append(box((0.1, 0, pick(rng, 1.0, 2.6)), (0.25, 0.3, pick(rng, 0.4, 0.9)), 0.3))
    return join(parts).named(Part.POLE)


def lamp_post(rng: np.random.Generator) -> Mesh:
    """A post of painted steel or concrete with a foot."""
    high, thick, paint = pick(rng, 5.0, 8.0), pick(rng, 0.05, 0.09), pick(rng, 0.3, 0.46)
    foot = tube((0, 0, 0), (0, 0, 1.1), (thick * 1.4, thick * 1.3), paint, 8)
    post = tube((0, 0, 1.0), (0, 0, high), (thick, 0.06), paint, 8)
    return join([foot, post]).named(Part.POLE)


def _hydrant(rng: np.random.Generator) -> Mesh:
    high = pick(rng, 0.6, 1.3)
    head = ellipsoid((0, 0, high), (0.17, 0.17, 0.17), 0.4)
    return join(
        [tube((0, 0, 0), (0, 0, high), (0.14, 0.12), 0.4), head, box((0, 0, 0.7 * high), (0.1, 0.45, 0.1), 0.4)]
    )


def _planter(rng: np.random.Generator) -> Mesh:
    high = pick(rng, 0.4, 0.7)
    plant = leaves(rng, (0, 0, high + 0.45), (0.35, 0.35, pick(rng, 0.35, 0.7)), 130, 0.2, _GREEN).named(
        Part.VEGETATION
    )
    return join([box((0, 0, high / 2), (0.7, 0.7, high), 0.4), plant])
