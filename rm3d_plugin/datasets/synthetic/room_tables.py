"""Tables, desks and kitchen rows: surfaces that people put things on, alike on purpose."""

import numpy as np

from rm3d_plugin.datasets.synthetic.road_users import pick
from rm3d_plugin.datasets.synthetic.room_materials import Material, Palette
from rm3d_plugin.datasets.synthetic.room_things import (
    Part,
    Thing,
    Top,
    block,
    ellipse,
    holed_sheet,
    rings,
    rod,
    rounded,
    thing,
    upright,
)


def _top_material(palette: Palette) -> Material:
    return palette.of('wood', 'wood', 'plastic', 'paint', 'metal', 'stone')


def _supports(
    rng: np.random.Generator, d: float, w: float, h: float, material: Material, pedestal: bool = True
) -> list[Part]:
    """What carries a plate of depth d, width w at height h."""
    kind = rng.random()
    if kind < 0.2 and pedestal:
        foot = ellipse((0, 0), (0.3 * min(d, w), 0.3 * min(d, w)))
        return [
            (rod((0, 0, 0), (0, 0, h), pick(rng, 0.03, 0.07), 8), material),
            (rings(foot, [(0, 1), (0.03, 0.9)]), material),
        ]
    inset, thick = pick(rng, 0.02, 0.08), pick(rng, 0.03, 0.08)
    x, y = d / 2 - inset - thick / 2, w / 2 - inset - thick / 2
    if kind < 0.38:
        return [(block((-x, s * y - 0.015, 0), (x, s * y + 0.015, h)), material) for s in (-1, 1)]
    if kind < 0.52:
        parts: list[Part] = []
        for s in (-1, 1):
            parts += [
                (block((-x, s * y - 0.03, 0), (x, s * y + 0.03, 0.04)), material),
                (block((-0.04, s * y - 0.03, 0.03), (0.04, s * y + 0.03, h)), material),
            ]
        return parts
    if kind < 0.75:
        return [
            (rod((sx * x, sy * y, 0), (sx * x * 0.95, sy * y * 0.95, h), thick / 2), material)
            for sx in (-1, 1)
            for sy in (-1, 1)
        ]
    legs: list[Part] = []
    for sx in (-1, 1):
        for sy in (-1, 1):
            legs.append(
                (
                    block((sx * x - thick / 2, sy * y - thick / 2, 0), (sx * x + thick / 2, sy * y + thick / 2, h)),
                    material,
                )
            )
    legs += [(block((s * x - 0.012, -y, h - 0.1), (s * x + 0.012, y, h)), material) for s in (-1, 1)]
    return legs


def table(rng: np.random.Generator, palette: Palette, seats: int = 4) -> Thing:
    """A dining or meeting table: rectangular, boat-shaped or round."""
    h, thick = pick(rng, 0.69, 0.79), pick(rng, 0.02, 0.06)
    surface = _top_material(palette)
    legs = surface if rng.random() < 0.4 else palette.of('wood', 'metal', 'plastic')
    if seats <= 4 and rng.random() < 0.35:
        r = pick(rng, 0.38, 0.65)
        plate = rings(ellipse((0, 0), (r, r), 20), [(h - thick, 1.0), (h, 1.0)])
        parts = [(plate, surface), *_supports(rng, 1.3 * r, 1.3 * r, h - thick, legs)]
        return thing('table', parts, [Top((-0.65 * r, 0.65 * r), (-0.65 * r, 0.65 * r), h)])
    d, w = pick(rng, 0.7, 1.05), pick(rng, 0.8, 1.5) if seats <= 4 else pick(rng, 1.6, 2.8)
    corner = pick(rng, 0.01, 0.3) if rng.random() < 0.4 else 0.01
    plate = rings(rounded((0, 0), (d, w), corner), [(h - thick, 1.0), (h, 1.0)])
    parts = [(plate, surface), *_supports(rng, d, w, h - thick, legs, pedestal=w < 1.2)]
    return thing('table', parts, [Top((-d / 2 + 0.12, d / 2 - 0.12), (-w / 2 + 0.15, w / 2 - 0.15), h)])


def coffee_table(rng: np.random.Generator, palette: Palette) -> Thing:
    """A low table, now and then a closed one."""
    h, d, w, thick = pick(rng, 0.32, 0.52), pick(rng, 0.45, 0.75), pick(rng, 0.5, 1.25), pick(rng, 0.02, 0.08)
    surface = _top_material(palette)
    legs = surface if rng.random() < 0.5 else palette.of('wood', 'metal')
    outline = ellipse((0, 0), (d / 2, w / 2), 20) if rng.random() < 0.3 else rounded((0, 0), (d, w), 0.03)
    parts: list[Part] = [(rings(outline, [(h - thick, 1.0), (h, 1.0)]), surface)]
    parts += _supports(rng, 0.85 * d, 0.85 * w, h - thick, legs)
    if rng.random() < 0.4:
        parts.append((block((-0.35 * d, -0.35 * w, 0.12), (0.35 * d, 0.35 * w, 0.14)), legs))
    return thing('coffee table', parts, [Top((-0.3 * d, 0.3 * d), (-0.3 * w, 0.3 * w), h)])


def desk(rng: np.random.Generator, palette: Palette) -> Thing:
    """A desk whose user sits at +x: frame, drawers, back panel, now and then a corner or shelves."""
    h, d, w, thick = pick(rng, 0.7, 0.79), pick(rng, 0.55, 0.85), pick(rng, 1.0, 1.8), pick(rng, 0.02, 0.05)
    surface = _top_material(palette)
    body = surface if rng.random() < 0.5 else palette.of('wood', 'metal', 'plastic')
    parts: list[Part] = [(block((-d / 2, -w / 2, h - thick), (d / 2, w / 2, h)), surface)]
    drawers = rng.random()
    sides = [-1.0] if drawers < 0.35 else [1.0] if drawers < 0.65 else [-1.0, 1.0] if drawers < 0.78 else []
    for s in (-1.0, 1.0):
        if s in sides:
            parts += drawer_block(
                (-d / 2 + 0.03, d / 2 - 0.03),
                sorted((s * w / 2, s * (w / 2 - pick(rng, 0.35, 0.48)))),
                (0.03, h - thick),
                3,
                body,
            )
        elif rng.random() < 0.5:
            y = sorted((s * w / 2, s * (w / 2 - 0.03)))
            parts.append((block((-d / 2 + 0.03, y[0], 0), (d / 2 - 0.05, y[1], h - thick)), body))
        else:
            y = sorted((s * w / 2, s * (w / 2 - 0.05)))
            parts += [(block((x, y[0], 0), (x + 0.05, y[1], h - thick)), body) for x in (-d / 2 + 0.02, d / 2 - 0.08)]
    if rng.random() < 0.6:
        parts.append(
            (block((-d / 2 + 0.03, -w / 2 + 0.02, pick(rng, 0.1, 0.4)), (-d / 2 + 0.05, w / 2 - 0.02, h - thick)), body)
        )
    if rng.random() < 0.2:
        top = h + pick(rng, 0.35, 0.6)
        parts += [(block((-d / 2, y, h), (-d / 2 + 0.25, y + 0.02, top)), body) for y in (-w / 2, 0.0, w / 2 - 0.02)]
        parts += [
            (block((-d / 2, -w / 2, z), (-d / 2 + 0.25, w / 2, z + 0.02)), body) for z in (top - 0.02, (h + top) / 2)
        ]
    return thing('desk', parts, [Top((-d / 2 + 0.12, d / 2 - 0.15), (-w / 2 + 0.2, w / 2 - 0.2), h)])


def drawer_block(
    x: tuple[float, float], y: list[float], z: tuple[float, float], count: int, material: Material
) -> list[Part]:
    """A body with drawer fronts and grips towards +x."""
    parts: list[Part] = [(block((x[0], y[0], z[0]), (x[1] - 0.02, y[1], z[1])), material)]
    step = (z[1] - z[0]) / count
    for i in range(count):
        low, high = z[0] + i * step + 0.008, z[0] + (i + 1) * step - 0.008
        parts.append((block((x[1] - 0.021, y[0] + 0.01, low), (x[1], y[1] - 0.01, high)), material))
        middle, mid = (y[0] + y[1]) / 2, high - min(0.06, step / 2)
        half = min(0.07, 0.3 * (y[1] - y[0]))
        parts.append((block((x[1], middle - half, mid - 0.01), (x[1] + 0.025, middle + half, mid + 0.01)), material))
    return parts


def door_fronts(x: float, y: tuple[float, float], z: tuple[float, float], count: int, material: Material) -> list[Part]:
    """Cabinet doors side by side on a front at x, with upright grips."""
    parts: list[Part] = []
    step = (y[1] - y[0]) / count
    for i in range(count):
        a, b = y[0] + i * step + 0.008, y[0] + (i + 1) * step - 0.008
        parts.append((block((x, a, z[0] + 0.01), (x + 0.02, b, z[1] - 0.01)), material))
        grip = b - 0.05 if i % 2 == 0 else a + 0.05
        middle = (z[0] + z[1]) / 2
        parts.append((rod((x + 0.035, grip, middle - 0.08), (x + 0.035, grip, middle + 0.08), 0.01, 5), material))
    return parts


def basin(
    rng: np.random.Generator, x: tuple[float, float], y: tuple[float, float], z: float, palette: Palette
) -> Thing:
    """A sink sunk into a surface at height z, with its tap."""
    material, tap = palette.of('metal', 'ceramic'), palette.of('metal')
    deep, rim = pick(rng, 0.13, 0.2), 0.02
    sheet = upright(holed_sheet(x[1] - x[0], y[1] - y[0], [(rim, x[1] - x[0] - rim, rim, y[1] - y[0] - rim)], deep))
    floor = block((x[0] + rim, y[0] + rim, z - deep - 0.01), (x[1] - rim, y[1] - rim, z - deep))
    parts: list[Part] = [(sheet.moved((x[0], y[0], z + 0.006)), material), (floor, material)]
    middle, high = (y[0] + y[1]) / 2, z + pick(rng, 0.15, 0.32)
    parts.append((rod((x[0] - 0.03, middle, z), (x[0] - 0.03, middle, high), 0.016), tap))
    parts.append((rod((x[0] - 0.03, middle, high), (x[0] + 0.14, middle, high - 0.03), 0.013), tap))
    return thing('sink', parts)


def counter_plate(
    x: tuple[float, float],
    y: tuple[float, float],
    z: float,
    thick: float,
    hole: tuple[float, float, float, float] | None,
    material: Material,
) -> list[Part]:
    """A slab at height z with a hole (x from, x to, y from, y to) for a basin."""
    if hole is None:
        return [(block((x[0], y[0], z - thick), (x[1], y[1], z)), material)]
    a, b, c, d = hole
    strips = [(x[0], a, *y), (b, x[1], *y), (a, b, y[0], c), (a, b, d, y[1])]
    return [(block((p, r, z - thick), (q, s, z)), material) for p, q, r, s in strips]


def kitchen_row(rng: np.random.Generator, palette: Palette, width: float, sink: bool = True) -> list[Thing]:
    """Base cabinets, a counter with a sink, wall cabinets above; backs at x = -d / 2."""
    d, h, thick = pick(rng, 0.58, 0.66), pick(rng, 0.85, 0.95), pick(rng, 0.03, 0.06)
    front = palette.of('wood', 'paint', 'plastic', 'metal')
    surface = palette.of('stone', 'wood', 'metal', 'plastic')
    units = max(1, round(width / pick(rng, 0.45, 0.6)))
    step = width / units
    base: list[Part] = [(block((-d / 2, -width / 2, 0.08), (d / 2 - 0.04, width / 2, h - thick)), front)]
    base.append((block((-d / 2, -width / 2, 0.0), (d / 2 - 0.1, width / 2, 0.08)), front))
    for i in range(units):
        y = [-width / 2 + i * step, -width / 2 + (i + 1) * step]
        if rng.random() < 0.35:
            base += drawer_block((d / 2 - 0.05, d / 2 - 0.02), y, (0.1, h - thick), 3 + int(rng.random() * 2), front)
        else:
            base += door_fronts(d / 2 - 0.04, (y[0], y[1]), (0.1, h - thick), 1 + int(rng.random() * 1.5), front)
    hole = None
    out: list[Thing] = []
    if sink and width > 0.9:
        half, middle = pick(rng, 0.2, 0.32), pick(rng, -width / 2 + 0.45, width / 2 - 0.45)
        hole = (-d / 2 + 0.12, d / 2 - 0.1, middle - half, middle + half)
        out.append(basin(rng, hole[:2], hole[2:], h, palette))
    spots = [Top((-d / 2 + 0.12, d / 2 - 0.12), (-width / 2 + 0.1, width / 2 - 0.1), h)]
    if hole:
        spots = [
            Top((-d / 2 + 0.12, d / 2 - 0.12), y, h)
            for y in ((-width / 2 + 0.1, hole[2] - 0.1), (hole[3] + 0.1, width / 2 - 0.1))
            if y[1] - y[0] > 0.15
        ]
    out.insert(0, thing('kitchen cabinet', base))
    plate = counter_plate((-d / 2, d / 2 + 0.02), (-width / 2, width / 2), h, thick, hole, surface)
    out.append(thing('counter', plate, spots))
    if rng.random() < 0.8:
        out.append(
            _wall_cabinets(rng, front if rng.random() < 0.8 else palette.of('wood', 'paint'), d, width, units, h)
        )
    return out


def _wall_cabinets(rng: np.random.Generator, front: Material, d: float, width: float, units: int, h: float) -> Thing:
    low, deep = h + pick(rng, 0.45, 0.6), pick(rng, 0.3, 0.38)
    high = low + pick(rng, 0.55, 0.85)
    keep = width if rng.random() < 0.5 else width * pick(rng, 0.5, 0.9)
    y = (-width / 2, -width / 2 + keep)
    parts: list[Part] = [(block((-d / 2, y[0], low), (-d / 2 + deep, y[1], high)), front)]
    parts += door_fronts(-d / 2 + deep, y, (low, high), max(1, round(units * keep / width)), front)
    return thing('kitchen cabinet', parts)


def vanity(rng: np.random.Generator, palette: Palette) -> list[Thing]:
    """A bathroom sink: on a column, on the wall, or in a cabinet with a counter."""
    w, d, h = pick(rng, 0.45, 0.65), pick(rng, 0.38, 0.5), pick(rng, 0.78, 0.9)
    if rng.random() < 0.5:
        white, tap = palette.of('ceramic'), palette.of('metal')
        bowl = rings(
            rounded((0, 0), (d, w), 0.14), [(h - 0.2, 0.45), (h - 0.1, 0.85), (h, 1.0), (h, 0.85), (h - 0.1, 0.6)]
        )
        parts: list[Part] = [(bowl, white), (rod((-d / 2 + 0.04, 0, h), (-d / 2 + 0.1, 0, h + 0.14), 0.015), tap)]
        if rng.random() < 0.6:
            parts.append((rings(ellipse((-0.05, 0), (0.1, 0.09)), [(0, 1.1), (0.1, 0.9), (h - 0.18, 1.0)]), white))
        return [thing('sink', parts)]
    w += pick(rng, 0.0, 0.5)
    front = palette.of('wood', 'paint', 'plastic')
    hole = (-d / 2 + 0.1, d / 2 - 0.06, -0.2, 0.2)
    body: list[Part] = [(block((-d / 2, -w / 2, 0.05), (d / 2 - 0.03, w / 2, h - 0.04)), front)]
    body += door_fronts(d / 2 - 0.03, (-w / 2, w / 2), (0.05, h - 0.04), 2, front)
    plate = counter_plate((-d / 2, d / 2), (-w / 2, w / 2), h, 0.04, hole, palette.of('stone', 'ceramic', 'wood'))
    sink = basin(rng, hole[:2], hole[2:], h, palette)
    return [thing('cabinet', body), sink, thing('counter', plate)]


def bathtub(rng: np.random.Generator, palette: Palette, length: float) -> Thing:
    """A tub along y with a hollow, its long side at the wall."""
    d, h, rim = pick(rng, 0.68, 0.82), pick(rng, 0.45, 0.62), pick(rng, 0.05, 0.09)
    white = palette.of('ceramic', 'ceramic', 'metal')
    apron = white if rng.random() < 0.6 else palette.of('tile', 'paint')
    hollow = rounded((0, 0), (d - 2 * rim, length - 2 * rim), 0.18)
    deep = pick(rng, 0.08, 0.16)
    # The hollow's upper end stays open: its lid would close the tub.
    inner = rings(hollow, [(deep, 0.82), (h - 0.2, 0.93), (h, 1.0)], lids=(True, False))
    parts: list[Part] = [(inner, white)]
    for x in (-1.0, 1.0):
        a, b = sorted((x * d / 2, x * (d / 2 - rim)))
        parts.append((block((a, -length / 2, 0.0), (b, length / 2, h)), apron))
    for y in (-1.0, 1.0):
        a, b = sorted((y * length / 2, y * (length / 2 - rim)))
        parts.append((block((-d / 2 + rim, a, 0.0), (d / 2 - rim, b, h)), apron))
    parts.append((rod((-d / 2 + 0.05, 0.0, h), (-d / 2 + 0.18, 0.0, h + 0.12), 0.02), palette.of('metal')))
    return thing('bathtub', parts)
