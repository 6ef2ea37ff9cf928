"""Chairs, sofas, beds and the toilet, each one different."""

import numpy as np

from rm3d_plugin.datasets.synthetic.road_users import pick, vary
from rm3d_plugin.datasets.synthetic.room_materials import Material, Palette
from rm3d_plugin.datasets.synthetic.room_things import (
    Part,
    Thing,
    Top,
    block,
    cushion,
    ellipse,
    rings,
    rod,
    rounded,
    thing,
    tilted,
)
from rm3d_plugin.datasets.synthetic.shapes import cos_sin


def chair(rng: np.random.Generator, palette: Palette) -> Thing:
    """A chair: four legs, office, tub, cantilever, or a wide armchair."""
    chance = rng.random()
    if chance < 0.42:
        return four_leg_chair(rng, palette)
    if chance < 0.72:
        return office_chair(rng, palette)
    if chance < 0.86:
        return armchair(rng, palette)
    return cantilever_chair(rng, palette)


def _legs(w: float, d: float, h: float, thick: float, material: Material, round_legs: bool) -> list[Part]:
    parts: list[Part] = []
    for x in (-d / 2 + thick, d / 2 - thick):
        for y in (-w / 2 + thick, w / 2 - thick):
            r = thick / 2
            leg = rod((x, y, 0), (x, y, h), r) if round_legs else block((x - r, y - r, 0), (x + r, y + r, h))
            parts.append((leg, material))
    return parts


def _back(rng: np.random.Generator, w: float, x: float, low: float, high: float, material: Material) -> list[Part]:
    """A back rest at x: a panel, slats, bars or a frame with cloth."""
    kind, thick = rng.random(), pick(rng, 0.02, 0.05)
    if kind < 0.4:
        return [(cushion((x, -w / 2, low), (x + thick, w / 2, high), 0.03), material)]
    posts: list[Part] = [(block((x, y, 0.4), (x + 0.03, y + 0.03, high)), material) for y in (-w / 2, w / 2 - 0.03)]
    if kind < 0.7:
        count = 2 + int(rng.random() * 3)
        step = (high - low) / count
        return posts + [
            (block((x, -w / 2, low + i * step + 0.3 * step), (x + 0.02, w / 2, low + (i + 0.9) * step)), material)
            for i in range(count)
        ]
    count = 3 + int(rng.random() * 4)
    places = [w * ((i + 0.5) / count - 0.5) for i in range(count)]
    bars: list[Part] = [(block((x, y - 0.012, 0.45), (x + 0.02, y + 0.012, high)), material) for y in places]
    return posts + bars + [(block((x, -w / 2, high - 0.07), (x + 0.03, w / 2, high)), material)]


def four_leg_chair(rng: np.random.Generator, palette: Palette) -> Thing:
    """A kitchen or meeting chair."""
    w, d, h = pick(rng, 0.38, 0.54), pick(rng, 0.38, 0.52), pick(rng, 0.41, 0.5)
    high = h + pick(rng, 0.28, 0.62)
    frame = palette.of('wood', 'metal', 'plastic')
    seat = palette.of('fabric', 'plastic', 'wood') if rng.random() < 0.6 else frame
    parts = _legs(w, d, h, pick(rng, 0.03, 0.05), frame, rng.random() < 0.5)
    parts.append((cushion((-d / 2, -w / 2, h - pick(rng, 0.03, 0.08)), (d / 2, w / 2, h), 0.04), seat))
    lean = pick(rng, 0.0, 0.22)
    back = _back(rng, w, -d / 2, h + pick(rng, 0.02, 0.15), high, seat if rng.random() < 0.6 else frame)
    parts += [(tilted(body, lean, (-d / 2, 0, h)), material) for body, material in back]
    if rng.random() < 0.3:
        parts += _arms(d, w, h, pick(rng, 0.18, 0.25), frame)
    return thing('chair', parts)


def _arms(d: float, w: float, h: float, rise: float, material: Material) -> list[Part]:
    parts: list[Part] = []
    for side in (-1.0, 1.0):
        y = side * (w / 2 + 0.01)
        parts.append((block((-d / 2, y - 0.025, h + rise - 0.03), (d / 2 - 0.08, y + 0.025, h + rise)), material))
        parts.append((rod((d / 2 - 0.12, y, h - 0.05), (d / 2 - 0.12, y, h + rise - 0.02), 0.016), material))
    return parts


def office_chair(rng: np.random.Generator, palette: Palette) -> Thing:
    """Five castors, a column, a cushioned seat, a back on a bar."""
    w, d, h = pick(rng, 0.44, 0.54), pick(rng, 0.42, 0.52), pick(rng, 0.43, 0.56)
    base, seat = palette.of('plastic', 'metal'), palette.of('fabric', 'plastic')
    parts: list[Part] = [(rod((0, 0, 0.1), (0, 0, h - 0.05), 0.03), base)]
    for k in range(5):
        c, s = (float(v) for v in cos_sin(2 * np.pi * k / 5 + 0.3))
        r = pick(rng, 0.26, 0.32)
        parts.append((rod((0, 0, 0.12), (r * c, r * s, 0.07), 0.02), base))
        parts.append((block((r * c - 0.025, r * s - 0.025, 0), (r * c + 0.025, r * s + 0.025, 0.06)), base))
    parts.append((cushion((-d / 2, -w / 2, h - 0.08), (d / 2, w / 2, h), 0.06), seat))
    low, high = h + pick(rng, 0.06, 0.2), h + pick(rng, 0.42, 0.75)
    narrow = pick(rng, 0.8, 1.0) * w / 2
    back = cushion((-d / 2 - 0.03, -narrow, low), (-d / 2 + 0.04, narrow, high), 0.05)
    lean = pick(rng, 0.05, 0.25)
    parts.append((tilted(back, lean, (-d / 2, 0, h)), seat if rng.random() < 0.7 else palette.of('fabric', 'plastic')))
    parts.append((rod((-d / 2, 0, h - 0.05), (-d / 2 - 0.02, 0, low + 0.1), 0.025), base))
    if rng.random() < 0.65:
        parts += _arms(d, w, h, pick(rng, 0.18, 0.26), base)
    return thing('office chair', parts)


def cantilever_chair(rng: np.random.Generator, palette: Palette) -> Thing:
    """Bent tubes with a shell."""
    w, d, h = pick(rng, 0.42, 0.54), pick(rng, 0.42, 0.55), pick(rng, 0.42, 0.48)
    frame, shell = palette.of('metal', 'plastic'), palette.of('plastic', 'fabric', 'wood')
    parts: list[Part] = []
    for y in (-w / 2, w / 2):
        parts += [
            (rod((-d / 2, y, 0.015), (d / 2, y, 0.015), 0.014), frame),
            (rod((d / 2, y, 0.015), (d / 2 - 0.04, y, h), 0.014), frame),
            (rod((d / 2 - 0.04, y, h - 0.02), (-d / 2, y, h - 0.02), 0.014), frame),
        ]
    parts.append((rod((-d / 2, -w / 2, 0.015), (-d / 2, w / 2, 0.015), 0.014), frame))
    parts.append((cushion((-d / 2, -w / 2, h - 0.03), (d / 2, w / 2, h + 0.01), 0.03), shell))
    back = cushion((-d / 2 - 0.02, -w / 2, h), (-d / 2 + 0.02, w / 2, h + pick(rng, 0.32, 0.5)), 0.03)
    parts.append((tilted(back, pick(rng, 0.1, 0.3), (-d / 2, 0, h)), shell))
    return thing('chair', parts)


def armchair(rng: np.random.Generator, palette: Palette) -> Thing:
    """A small sofa for one, or a tub chair."""
    if rng.random() < 0.4:
        return _tub_chair(rng, palette)
    return thing('armchair', _upholstered(rng, palette, pick(rng, 0.66, 0.95), 1)[0])


def _tub_chair(rng: np.random.Generator, palette: Palette) -> Thing:
    w, d, h, high = pick(rng, 0.55, 0.75), pick(rng, 0.55, 0.7), pick(rng, 0.38, 0.46), pick(rng, 0.65, 0.85)
    cloth, frame = palette.of('fabric', 'plastic'), palette.of('wood', 'metal')
    parts: list[Part] = [(rings(rounded((0, 0), (d, w), 0.2), [(0.15, 0.9), (h, 1.0)]), cloth)]
    for k in range(9):
        c, s = (float(v) for v in cos_sin(np.pi * (0.5 + k / 8)))
        x, y = c * (d / 2 - 0.04), s * (w / 2 - 0.04)
        lift = high - 0.12 * abs(s)
        parts.append((rod((x, y, h - 0.05), (x * 1.05, y * 1.05, lift), 0.075, 5), cloth))
    parts += [(rod((x, y, 0), (x * 0.9, y * 0.9, 0.17), 0.018), frame) for x in (-0.2, 0.2) for y in (-0.2, 0.2)]
    return thing('armchair', parts)


def sofa(rng: np.random.Generator, palette: Palette) -> Thing:
    """Two to four seats, with or without a chaise."""
    seats = 2 + int(rng.random() * 2.4)
    width = seats * pick(rng, 0.52, 0.72) + pick(rng, 0.15, 0.4)
    parts, (d, h) = _upholstered(rng, palette, width, seats)
    if rng.random() < 0.25:
        side = -1.0 if rng.random() < 0.5 else 1.0
        y = sorted((side * width / 2, side * (width / 2 - pick(rng, 0.6, 0.8))))
        parts.append((cushion((d / 2 - 0.05, y[0], 0.06), (d / 2 + pick(rng, 0.4, 0.75), y[1], h), 0.06), parts[0][1]))
    return thing('couch', parts, [Top((-0.1, d / 2 - 0.15), (-width / 2 + 0.3, width / 2 - 0.3), h)])


def _upholstered(
    rng: np.random.Generator, palette: Palette, width: float, seats: int
) -> tuple[list[Part], tuple[float, float]]:
    """Base, cushions, back and arms; also depth and seat height."""
    d, h, high = pick(rng, 0.72, 1.0), pick(rng, 0.36, 0.48), pick(rng, 0.62, 0.95)
    arm, rise = (pick(rng, 0.08, 0.26), pick(rng, 0.08, 0.24)) if rng.random() < 0.85 else (0.0, 0.0)
    thick, foot = pick(rng, 0.14, 0.28), pick(rng, 0.03, 0.16)
    cloth = palette.of('fabric', 'fabric', 'plastic')
    pads = cloth if rng.random() < 0.6 else palette.of('fabric')
    inner = width - 2 * arm
    parts: list[Part] = [(block((-d / 2, -width / 2, foot), (d / 2 - 0.03, width / 2, h - 0.12)), cloth)]
    for i in range(seats):
        y0, y1 = -inner / 2 + inner * i / seats, -inner / 2 + inner * (i + 1) / seats
        parts.append((cushion((-d / 2 + thick - 0.02, y0 + 0.005, h - 0.14), (d / 2, y1 - 0.005, h), 0.05), pads))
        back = cushion((-d / 2 + 0.03, y0 + 0.01, h), (-d / 2 + thick, y1 - 0.01, high), 0.06)
        parts.append((tilted(back, pick(rng, 0.0, 0.15), (-d / 2 + thick, 0, h)), pads))
    parts.append(
        (cushion((-d / 2, -width / 2, foot), (-d / 2 + 0.1, width / 2, high - pick(rng, 0.0, 0.1)), 0.04), cloth)
    )
    for side in (-1.0, 1.0):
        if arm:
            y = sorted((side * width / 2, side * (width / 2 - arm)))
            parts.append((cushion((-d / 2, y[0], foot), (d / 2 - 0.02, y[1], h + rise), 0.05), cloth))
    leg = palette.of('wood', 'metal')
    parts += [
        (rod((x, y, 0), (x, y, foot + 0.01), 0.025), leg)
        for x in (-d / 2 + 0.06, d / 2 - 0.1)
        for y in (-width / 2 + 0.06, width / 2 - 0.06)
    ]
    return parts, (d, h)


def bed(rng: np.random.Generator, palette: Palette) -> list[Thing]:
    """A bed with its head at -x, and its pillows."""
    length, width = vary(rng, 2.0, 0.06), (pick(rng, 0.85, 1.1), pick(rng, 1.3, 1.85))[int(rng.random() < 0.6)]
    h, base = pick(rng, 0.36, 0.68), pick(rng, 0.12, 0.3)
    frame, sheet = palette.of('wood', 'fabric', 'metal', 'plastic'), palette.of('fabric', 'fabric', 'paint')
    cover = palette.of('fabric')
    low = pick(rng, 0.0, 0.15) if rng.random() < 0.6 else 0.0
    parts: list[Part] = [(block((-length / 2, -width / 2, low), (length / 2, width / 2, base)), frame)]
    parts.append(
        (cushion((-length / 2 + 0.02, -width / 2 + 0.02, base), (length / 2 - 0.02, width / 2 - 0.02, h), 0.05), sheet)
    )
    if rng.random() < 0.75:
        start = -length / 2 + pick(rng, 0.4, 1.1)
        hang = pick(rng, 0.05, h - 0.08)
        blanket = cushion(
            (start, -width / 2 - 0.02, h - hang), (length / 2 + 0.01, width / 2 + 0.02, h + pick(rng, 0.02, 0.06)), 0.04
        )
        parts.append((blanket, cover))
    if rng.random() < 0.7:
        high, thick = pick(rng, h + 0.15, 1.25), pick(rng, 0.04, 0.12)
        parts.append((block((-length / 2 - thick, -width / 2 - 0.02, 0), (-length / 2, width / 2 + 0.02, high)), frame))
    if rng.random() < 0.25:
        parts.append(
            (block((length / 2, -width / 2, 0), (length / 2 + 0.05, width / 2, pick(rng, h, h + 0.25))), frame)
        )
    out = [thing('bed', parts, [Top((-0.2, 0.8), (-width / 2 + 0.25, width / 2 - 0.25), h + 0.05)])]
    count = 1 if width < 1.2 else 2
    for i in range(count):
        y = -width / 2 + width * (i + 0.5) / count
        half = min(0.35, width / count / 2 - 0.06)
        soft = cushion(
            (-length / 2 + 0.06, y - half, h - 0.02),
            (-length / 2 + pick(rng, 0.4, 0.55), y + half, h + pick(rng, 0.08, 0.16)),
            0.1,
        )
        out.append(thing('pillow', [(soft, sheet if rng.random() < 0.4 else palette.of('fabric'))]))
    return out


def toilet(rng: np.random.Generator, palette: Palette) -> Thing:
    """Bowl, seat or raised lid, and a cistern."""
    white = palette.of('ceramic')
    h, long, wide = pick(rng, 0.38, 0.46), pick(rng, 0.2, 0.26), pick(rng, 0.16, 0.2)
    bowl = rings(ellipse((0.1, 0), (long, wide)), [(0.0, 0.6), (0.12, 0.55), (0.25, 0.75), (h - 0.03, 1.0), (h, 1.0)])
    parts: list[Part] = [(bowl, white)]
    seat = white if rng.random() < 0.6 else palette.of('plastic', 'wood')
    parts.append((rings(ellipse((0.1, 0), (long + 0.015, wide + 0.015)), [(h, 1.0), (h + 0.03, 0.98)]), seat))
    if rng.random() < 0.4:
        lid = rings(ellipse((0.1, 0), (long, wide)), [(h + 0.03, 1.0), (h + 0.05, 1.0)])
        parts.append((tilted(lid, pick(rng, 1.4, 1.6), (0.1 - long, 0, h + 0.04)), seat))
    tank = pick(rng, 0.17, 0.24)
    if rng.random() < 0.75:
        half, top = pick(rng, 0.17, 0.24), pick(rng, 0.68, 0.9)
        parts.append((cushion((-0.1 - tank, -half, h - 0.06), (-0.1, half, top), 0.03), white))
        parts.append((cushion((-0.11 - tank, -half - 0.01, top), (-0.09, half + 0.01, top + 0.03), 0.02), white))
    parts.append((block((-0.1 - tank, -0.1, 0.0), (0.0, 0.1, h - 0.04)), white))
    return thing('toilet', parts)


def ottoman(rng: np.random.Generator, palette: Palette) -> Thing:
    """A cushioned cube or drum."""
    w, d, h = pick(rng, 0.4, 0.9), pick(rng, 0.38, 0.6), pick(rng, 0.34, 0.48)
    cloth = palette.of('fabric', 'plastic')
    if rng.random() < 0.4:
        return thing(
            'ottoman', [(rings(ellipse((0, 0), (d / 2, d / 2)), [(0.02, 0.95), (h - 0.04, 1.0), (h, 0.9)]), cloth)]
        )
    return thing('ottoman', [(cushion((-d / 2, -w / 2, 0.03), (d / 2, w / 2, h), 0.05), cloth)])
