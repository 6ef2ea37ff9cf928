"""What streets have beside what a detector looks for: lorries, buses, motorcycles, traffic lights, guard rails."""

import numpy as np

from rm3d_plugin.datasets.synthetic.parts import Part
from rm3d_plugin.datasets.synthetic.road_users import cyclist, pick
from rm3d_plugin.datasets.synthetic.shapes import Mesh, box, ellipsoid, join, tube
from rm3d_plugin.datasets.synthetic.street_ground import PARKING
from rm3d_plugin.datasets.synthetic.streets import Street, footprint

Size = tuple[float, float, float]
_TYRE = 0.06


def add_extras(street: Street, rng: np.random.Generator) -> None:
    """Put them into a finished street, where there is room."""
    road = street.road
    oncoming = road.left - (PARKING if road.parked_left else 0.0) - 1.9
    for _ in range(1 + int(rng.random() * 2.5)):
        maker = (truck, truck, bus)[int(rng.random() * 3)]
        ahead = rng.random() < 0.4
        offset, turn = (0.0, 0.0) if ahead else (oncoming, float(np.pi))
        _put(street, *maker(rng), pick(rng, 14.0, 55.0), offset, turn + pick(rng, -0.04, 0.04))
    for side in (road.left, road.right):
        out = float(np.sign(side))
        for _ in range(int(rng.random() * 3)):
            x, near = pick(rng, -8.0, 40.0), side + out * pick(rng, 0.5, 1.2)
            _put(street, *motorcycle(rng), x, near, pick(rng, -0.4, 0.4))
        if rng.random() < 0.6:
            x = pick(rng, 3.0, 30.0)
            for place in (x, x + pick(rng, 6.0, 14.0)):
                _put(street, traffic_light(rng), (0.4, 0.4, 3.5), place, side + out * 0.45, np.pi)
        for _ in range(4):  # most places are taken
            length, place = pick(rng, 5.0, 12.0), pick(rng, -15.0, 40.0)
            _put(street, guardrail(rng, length), (length, 0.3, 0.8), place, side + out * 0.25, 0.0)
    for _ in range(1 + int(rng.random() * 2)):
        offset = pick(rng, -0.8, 0.8) if rng.random() < 0.5 else oncoming + pick(rng, -0.6, 0.6)
        _put(street, *motorcyclist(rng), pick(rng, 5.0, 40.0), offset, 0.0 if offset < 1.0 else np.pi)


def _put(street: Street, mesh: Mesh, size: Size, x: float, offset: float, turn: float) -> None:
    """Put a thing there unless its place is taken."""
    px, py = street.road.point(x, offset)
    circles = footprint(size, px, py, street.road.heading(x) + turn, gap=0.05)
    if street.free(circles):
        street.taken += circles
        street.add_thing(mesh, x, offset, turn)


def truck(rng: np.random.Generator) -> tuple[Mesh, Size]:
    """A lorry: cab, load, wheels."""
    length, width, high = pick(rng, 6.5, 9.5), pick(rng, 2.2, 2.5), pick(rng, 2.8, 3.6)
    cab = pick(rng, 1.6, 2.1)
    front, back = length / 2, -length / 2
    load = length - cab - 0.3
    parts = [
        box((front - cab / 2, 0, 0.5 + high * 0.38), (cab, width, high * 0.76), pick(rng, 0.1, 0.6)),
        box((front - 0.02, 0, high * 0.62), (0.06, width * 0.9, 0.8), 0.08, 0.7),
        box((back + load / 2, 0, 0.9 + (high - 0.9) / 2), (load, width, high - 0.9), pick(rng, 0.2, 0.6)),
        box((0, 0, 0.7), (length * 0.95, 0.9, 0.25), 0.2),
    ]
    parts += _wheels((front - 1.0, back + 1.2, back + 2.4), width, 0.48)
    return join(parts).named(Part.TRUCK), (length, width, high)


def bus(rng: np.random.Generator) -> tuple[Mesh, Size]:
    """A bus with rows of windows; data sets count it as another vehicle, a trailer as well."""
    length, width, high = pick(rng, 9.0, 12.0), 2.5, pick(rng, 2.9, 3.2)
    paint = pick(rng, 0.2, 0.6)
    parts = [box((0, 0, 0.35 + (high - 0.35) / 2), (length, width, high - 0.35), paint)]
    for side in (-1.0, 1.0):
        middles = np.arange(-length / 2 + 0.9, length / 2 - 0.5, 1.4)
        parts += [box((float(x), side * width / 2, 2.0), (1.2, 0.04, 0.9), 0.08, 0.7) for x in middles]
    parts.append(box((length / 2, 0, 1.9), (0.04, width * 0.9, 1.3), 0.08, 0.7))
    parts += _wheels((length / 2 - 2.2, -length / 2 + 2.6), width, 0.48)
    return join(parts).named(Part.TRAILER), (length, width, high)


def _wheels(places: tuple[float, ...], width: float, radius: float) -> list[Mesh]:
    return [
        tube((x, s * (width / 2 - 0.28), radius), (x, s * (width / 2), radius), (radius, radius), _TYRE, sides=10)
        for x in places
        for s in (-1.0, 1.0)
    ]


def _motorcycle_body(rng: np.random.Generator) -> Mesh:
    steel, radius = pick(rng, 0.1, 0.6), 0.31
    wheels = [tube((x, -0.07, radius), (x, 0.07, radius), (radius, radius), _TYRE, 12) for x in (-0.68, 0.7)]
    parts = [
        ellipsoid((0.12, 0, 0.82), (0.36, 0.18, 0.17), steel),
        box((-0.42, 0, 0.82), (0.75, 0.26, 0.14), 0.08),
        box((0.0, 0, 0.48), (0.62, 0.34, 0.42), steel),
        tube((0.7, 0, radius), (0.42, 0, 1.02), (0.06, 0.05), steel, 6),
        tube((0.4, -0.36, 1.05), (0.4, 0.36, 1.05), (0.025, 0.025), 0.2, 5),
        ellipsoid((0.55, 0, 0.95), (0.13, 0.16, 0.16), 0.5),
    ]
    return join(parts + wheels)


def motorcycle(rng: np.random.Generator) -> tuple[Mesh, Size]:
    """A parked motorcycle."""
    return _motorcycle_body(rng).named(Part.MOTORCYCLE), (2.1, 0.75, 1.15)


def motorcyclist(rng: np.random.Generator) -> tuple[Mesh, Size]:
    """Someone on a motorcycle."""
    rider = cyclist(rng).mesh.moved((-0.1, 0.0, 0.0), scale=(1.0, 1.0, 0.97))
    above = rider.corners[:, :, 2].min(axis=1) > 0.55  # leaves the bicycle's wheels out
    upper = Mesh(rider.corners[above], rider.reflectance[above], rider.dropout[above])
    helmet = ellipsoid((0.1, 0, 1.62), (0.15, 0.14, 0.16), 0.3)
    return join([_motorcycle_body(rng), upper, helmet]).named(Part.MOTORCYCLIST), (2.1, 0.75, 1.7)


def traffic_light(rng: np.random.Generator) -> Mesh:
    """A post with one or two heads that face +x; the post is a pole."""
    high = pick(rng, 2.8, 3.6)
    post = tube((0, 0, 0), (0, 0, high), (0.07, 0.06), 0.35, 8).named(Part.POLE)
    heads = [box((0.16, 0, high - 0.35), (0.22, 0.32, 0.95), 0.12)]
    if rng.random() < 0.5:
        heads.append(box((0.16, 0, high - 1.5), (0.2, 0.28, 0.7), 0.12))
    return join([post, *[head.named(Part.TRAFFIC_LIGHT) for head in heads]])


def guardrail(rng: np.random.Generator, length: float) -> Mesh:
    """A steel rail on posts, along x."""
    high = pick(rng, 0.65, 0.8)
    posts = [box((float(x), 0, high / 2), (0.1, 0.1, high), 0.42) for x in np.arange(-length / 2, length / 2, 2.0)]
    rails = [box((0, -0.08, high - d), (length, 0.05, 0.13), 0.45) for d in (0.1, 0.28)]
    return join(posts + rails).named(Part.GUARDRAIL)
