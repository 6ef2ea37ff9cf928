"""Small things on floors and tables; benchmarks ignore most of them, and they hide what is labelled."""

import numpy as np

from rm3d_plugin.datasets.synthetic.road_users import pick
from rm3d_plugin.datasets.synthetic.room_materials import Palette
from rm3d_plugin.datasets.synthetic.room_things import Part, Thing, block, cushion, ellipse, rings, rod, thing, tilted
from rm3d_plugin.datasets.synthetic.shapes import box, cos_sin, ellipsoid, leaves


def carton(rng: np.random.Generator, palette: Palette, size: float = 1.0) -> Thing:
    """One to three boxes, stacked askew."""
    parts: list[Part] = []
    z = 0.0
    for _ in range(1 + int(rng.random() ** 2 * 3)):
        d, w, h = (size * pick(rng, 0.15, 0.5) for _ in range(3))
        body = box((0.0, 0.0, z + h / 2), (d, w, h), 0.5, yaw=pick(rng, -0.3, 0.3))
        parts.append((body, palette.of('wood', 'paint', 'plastic', 'print')))
        z += h
    return thing('box', parts)


def bag(rng: np.random.Generator, palette: Palette) -> Thing:
    """A slumped bag or a rucksack."""
    d, w, h = pick(rng, 0.1, 0.2), pick(rng, 0.15, 0.26), pick(rng, 0.28, 0.5)
    cloth = palette.of('fabric', 'plastic')
    body = rings(ellipse((0, 0), (d, w), 12), [(0.0, 0.8), (0.3 * h, 1.0), (0.8 * h, 0.8), (h, 0.35)])
    slumped = tilted(body, pick(rng, -0.25, 0.25), (0, 0, 0))
    parts: list[Part] = [(slumped.moved((0, 0, -float(slumped.bounds[0][2]))), cloth)]
    if rng.random() < 0.6:
        parts.append((cushion((d * 0.7, -0.7 * w, 0.04), (d + 0.07, 0.7 * w, 0.5 * h), 0.03), cloth))
    return thing('bag', parts)


def floor_lamp(rng: np.random.Generator, palette: Palette) -> Thing:
    """A foot, a pole and a shade."""
    return _lamp(rng, palette, pick(rng, 1.3, 1.8), pick(rng, 0.13, 0.24))


def table_lamp(rng: np.random.Generator, palette: Palette) -> Thing:
    """A small one."""
    return _lamp(rng, palette, pick(rng, 0.32, 0.55), pick(rng, 0.08, 0.16))


def _lamp(rng: np.random.Generator, palette: Palette, h: float, r: float) -> Thing:
    pole, shade = palette.of('metal', 'wood', 'plastic'), palette.of('fabric', 'paint')
    tall = min(0.4 * h, pick(rng, 0.2, 0.35))
    parts: list[Part] = [(rings(ellipse((0, 0), (0.9 * r, 0.9 * r), 12), [(0, 1), (0.03, 0.9)]), pole)]
    parts.append((rod((0, 0, 0.02), (0, 0, h - 0.5 * tall), 0.014), pole))
    parts.append((rings(ellipse((0, 0), (r, r), 12), [(h - tall, 1.0), (h, pick(rng, 0.5, 1.0))]), shade))
    return thing('lamp', parts)


def plant(rng: np.random.Generator, palette: Palette, size: float = 1.0) -> Thing:
    """Leaves over a pot."""
    r, pot = size * pick(rng, 0.1, 0.2), size * pick(rng, 0.15, 0.35)
    crown, high = size * pick(rng, 0.18, 0.4), size * pick(rng, 0.35, 1.0)
    green = palette.of('leaf')
    parts: list[Part] = [
        (
            rings(ellipse((0, 0), (r, r), 12), [(0, 0.75), (pot, 1.0), (pot, 0.85)]),
            palette.of('stone', 'ceramic', 'plastic'),
        )
    ]
    parts.append((rod((0, 0, pot), (0, 0, pot + 0.7 * high), 0.012 * size), green))
    foliage = leaves(rng, (0, 0, pot + 0.6 * high), (crown, crown, 0.5 * high), 70, 0.16 * size, 0.5)
    parts.append((foliage, green))
    return thing('plant', parts)


def trash_can(rng: np.random.Generator, palette: Palette) -> Thing:
    """Round or square, with or without a lid."""
    r, h = pick(rng, 0.11, 0.2), pick(rng, 0.25, 0.65)
    skin = palette.of('plastic', 'metal')
    outline = ellipse((0, 0), (r, r), 14) if rng.random() < 0.6 else ellipse((0, 0), (r * 1.3, r * 1.3), 4)
    closed = rng.random() < 0.4
    levels = [(0.0, 0.8), (h, 1.0), (h + 0.05, 0.6)] if closed else [(0.0, 0.8), (h, 1.0), (h, 0.93), (0.05, 0.75)]
    return thing('trash can', [(rings(outline, levels), skin)])


def monitor(rng: np.random.Generator, palette: Palette) -> Thing:
    """A screen on a stand, facing +x."""
    w, low = pick(rng, 0.42, 0.7), pick(rng, 0.08, 0.15)
    body = palette.of('plastic')
    parts: list[Part] = [
        (block((-0.1, -0.12, 0.0), (0.1, 0.12, 0.015)), body),
        (rod((-0.05, 0, 0.01), (-0.03, 0, low + 0.1), 0.02), body),
    ]
    parts.append((block((-0.03, -w / 2, low), (0.01, w / 2, low + 0.6 * w)), body))
    parts.append(
        (block((0.011, -w / 2 + 0.02, low + 0.02), (0.014, w / 2 - 0.02, low + 0.6 * w - 0.02)), palette.of('screen'))
    )
    return thing('monitor', parts)


def pile(rng: np.random.Generator, palette: Palette) -> Thing:
    """Books or paper on each other."""
    parts: list[Part] = []
    z = 0.0
    for _ in range(1 + int(rng.random() * 5)):
        t = pick(rng, 0.015, 0.05)
        parts.append(
            (
                box((0, 0, z + t / 2), (pick(rng, 0.15, 0.23), pick(rng, 0.2, 0.31), t), 0.5, yaw=pick(rng, -0.5, 0.5)),
                palette.of('print', 'paint'),
            )
        )
        z += t
    return thing('books', parts)


def bottle(rng: np.random.Generator, palette: Palette) -> Thing:
    """A bottle, a jar or a cup."""
    r, h = pick(rng, 0.03, 0.07), pick(rng, 0.09, 0.33)
    return thing(
        'bottle',
        [
            (
                rings(ellipse((0, 0), (r, r), 10), [(0, 1), (0.6 * h, 1), (h, pick(rng, 0.4, 1.0))]),
                palette.of('plastic', 'ceramic', 'metal'),
            )
        ],
    )


def oddment(rng: np.random.Generator, palette: Palette) -> Thing:
    """Something that nobody annotated: a ball, a heap, a machine."""
    r = pick(rng, 0.06, 0.16)
    kind = rng.random()
    if kind < 0.4:
        return thing(
            'object', [(ellipsoid((0, 0, 0.8 * r), (r, 1.3 * r, 0.8 * r), 0.5), palette.of('fabric', 'plastic'))]
        )
    if kind < 0.7:
        d, w, h = pick(rng, 0.1, 0.18), pick(rng, 0.12, 0.25), pick(rng, 0.12, 0.35)
        return thing('object', [(cushion((-d, -w, 0.0), (d, w, h), 0.04), palette.of('metal', 'plastic'))])
    c, s = (float(v) for v in cos_sin(pick(rng, 0, 6.2)))
    parts: list[Part] = [
        (rod((-0.2 * c, -0.2 * s, 0.03), (0.2 * c, 0.2 * s, pick(rng, 0.03, 0.2)), 0.03), palette.of('plastic', 'wood'))
    ]
    return thing('object', parts)


def floor_clutter(rng: np.random.Generator, palette: Palette) -> Thing:
    """Anything that stands on a floor."""
    chance = rng.random()
    if chance < 0.28:
        return carton(rng, palette)
    if chance < 0.45:
        return bag(rng, palette)
    if chance < 0.6:
        return plant(rng, palette)
    if chance < 0.78:
        return trash_can(rng, palette)
    if chance < 0.88:
        return floor_lamp(rng, palette)
    return oddment(rng, palette)


def table_clutter(rng: np.random.Generator, palette: Palette) -> Thing:
    """Anything that stands on a table."""
    chance = rng.random()
    if chance < 0.25:
        return pile(rng, palette)
    if chance < 0.45:
        return bottle(rng, palette)
    if chance < 0.6:
        return carton(rng, palette, 0.5)
    if chance < 0.7:
        return plant(rng, palette, 0.45)
    if chance < 0.82:
        return table_lamp(rng, palette)
    return oddment(rng, palette)
