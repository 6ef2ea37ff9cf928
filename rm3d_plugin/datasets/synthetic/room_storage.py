"""Cabinets, shelves with books, refrigerators: boxes that differ in their fronts."""

import numpy as np

from rm3d_plugin.datasets.synthetic.road_users import pick
from rm3d_plugin.datasets.synthetic.room_materials import Material, Palette
from rm3d_plugin.datasets.synthetic.room_tables import door_fronts, drawer_block
from rm3d_plugin.datasets.synthetic.room_things import Part, Thing, Top, block, rod, thing


def cabinet(rng: np.random.Generator, palette: Palette) -> Thing:
    """Low or high, with doors or drawers; metal ones too."""
    low = rng.random() < 0.55
    d, w = pick(rng, 0.35, 0.6), pick(rng, 0.45, 1.4) if low else pick(rng, 0.6, 1.1)
    h, foot = (pick(rng, 0.6, 1.15) if low else pick(rng, 1.3, 1.95)), pick(rng, 0.0, 0.12)
    return thing(
        'cabinet',
        _closed(rng, palette, d, w, h, foot),
        [Top((-d / 2 + 0.1, d / 2 - 0.1), (-w / 2 + 0.12, w / 2 - 0.12), h)] if low else [],
    )


def wardrobe(rng: np.random.Generator, palette: Palette) -> Thing:
    """A high closet."""
    d, w, h = pick(rng, 0.52, 0.65), pick(rng, 0.8, 1.9), pick(rng, 1.8, 2.25)
    front = palette.of('wood', 'paint', 'plastic')
    parts: list[Part] = [(block((-d / 2, -w / 2, 0.0), (d / 2 - 0.02, w / 2, h)), front)]
    parts += door_fronts(d / 2 - 0.02, (-w / 2, w / 2), (0.08, h - 0.03), max(2, round(w / 0.5)), front)
    return thing('wardrobe closet', parts)


def _closed(rng: np.random.Generator, palette: Palette, d: float, w: float, h: float, foot: float) -> list[Part]:
    front = palette.of('wood', 'wood', 'paint', 'metal', 'plastic')
    body = front if rng.random() < 0.7 else palette.of('wood', 'paint')
    parts: list[Part] = [(block((-d / 2, -w / 2, foot), (d / 2 - 0.02, w / 2, h)), body)]
    if rng.random() < 0.45:
        rows = max(2, round((h - foot) / pick(rng, 0.22, 0.4)))
        parts += drawer_block((d / 2 - 0.05, d / 2), [-w / 2, w / 2], (foot + 0.02, h - 0.02), rows, front)
    else:
        parts += door_fronts(d / 2 - 0.02, (-w / 2, w / 2), (foot + 0.02, h - 0.02), max(1, round(w / 0.45)), front)
    if foot > 0.03:
        parts += [
            (rod((x, y, 0), (x, y, foot + 0.01), 0.02), body)
            for x in (-d / 2 + 0.05, d / 2 - 0.07)
            for y in (-w / 2 + 0.05, w / 2 - 0.05)
        ]
    return parts


def dresser(rng: np.random.Generator, palette: Palette) -> Thing:
    """A chest of drawers."""
    d, w, h = pick(rng, 0.4, 0.5), pick(rng, 0.8, 1.4), pick(rng, 0.7, 1.1)
    parts = drawer_block(
        (-d / 2, d / 2), [-w / 2, w / 2], (0.04, h), 3 + int(rng.random() * 3), palette.of('wood', 'paint')
    )
    return thing('dresser', parts, [Top((-d / 2 + 0.1, d / 2 - 0.1), (-w / 2 + 0.15, w / 2 - 0.15), h)])


def nightstand(rng: np.random.Generator, palette: Palette) -> Thing:
    """A small one beside a bed."""
    d, w, h = pick(rng, 0.35, 0.45), pick(rng, 0.38, 0.55), pick(rng, 0.42, 0.65)
    parts = drawer_block((-d / 2, d / 2), [-w / 2, w / 2], (pick(rng, 0.02, 0.2), h), 2, palette.of('wood', 'paint'))
    return thing('nightstand', parts, [Top((-0.08, 0.08), (-0.1, 0.1), h)])


def tv_stand(rng: np.random.Generator, palette: Palette) -> Thing:
    """A low board."""
    d, w, h = pick(rng, 0.35, 0.5), pick(rng, 0.9, 1.8), pick(rng, 0.35, 0.6)
    body = palette.of('wood', 'paint', 'plastic')
    parts: list[Part] = [
        (block((-d / 2, -w / 2, z), (d / 2, w / 2, z + 0.025)), body) for z in (0.05, h / 2, h - 0.025)
    ]
    parts += [(block((-d / 2, y, 0.0), (d / 2, y + 0.025, h)), body) for y in (-w / 2, -0.012, w / 2 - 0.025)]
    parts.append((block((-d / 2, -w / 2, 0.05), (-d / 2 + 0.015, w / 2, h)), body))
    return thing('tv stand', parts, [Top((-0.06, 0.06), (-w / 4, w / 4), h)])


def bookshelf(rng: np.random.Generator, palette: Palette) -> Thing:
    """Shelves with rows of books, piles and gaps; the back may be open."""
    d, w = pick(rng, 0.24, 0.38), pick(rng, 0.6, 1.6)
    h = pick(rng, 1.5, 2.2) if rng.random() < 0.7 else pick(rng, 0.8, 1.3)
    body, t = palette.of('wood', 'wood', 'paint', 'metal', 'plastic'), pick(rng, 0.018, 0.035)
    parts: list[Part] = [(block((-d / 2, y, 0.0), (d / 2, y + t, h)), body) for y in (-w / 2, w / 2 - t)]
    if w > 1.0:
        parts.append((block((-d / 2, -t / 2, 0.0), (d / 2, t / 2, h)), body))
    if rng.random() < 0.75:
        parts.append((block((-d / 2, -w / 2, 0.0), (-d / 2 + 0.01, w / 2, h)), body))
    rows = max(2, round(h / pick(rng, 0.3, 0.42)))
    step = (h - t) / rows
    covers = [palette.of('print', 'plastic', 'fabric') for _ in range(6)]
    full = pick(rng, 0.35, 0.95)
    for i in range(rows + 1):
        parts.append((block((-d / 2, -w / 2, i * step), (d / 2, w / 2, i * step + t)), body))
        if i < rows and rng.random() < full:
            parts += _books(rng, d, (-w / 2 + t, w / 2 - t), i * step + t, step - t, covers)
    return thing('bookshelf', parts)


def _books(
    rng: np.random.Generator, d: float, y: tuple[float, float], z: float, room: float, covers: list[Material]
) -> list[Part]:
    """A row of books that are a few centimetres thick, in groups of one colour."""
    parts: list[Part] = []
    at = y[0] + pick(rng, 0.0, 0.15)
    end = y[1] - (pick(rng, 0.0, 0.4) if rng.random() < 0.5 else 0.0)
    while at < end - 0.03:
        thick = pick(rng, 0.03, 0.13)
        if rng.random() < 0.15:
            at += pick(rng, 0.05, 0.25)
            continue
        stop = min(at + thick, end)
        high = z + room * pick(rng, 0.55, 0.92)
        front = d / 2 - pick(rng, 0.01, 0.08)
        parts.append((block((-d / 2 + 0.02, at, z), (front, stop, high)), covers[int(rng.random() * len(covers))]))
        at = stop
    return parts


def refrigerator(rng: np.random.Generator, palette: Palette) -> Thing:
    """One or two doors, or a pair of wings, with long grips."""
    d, w, h = pick(rng, 0.58, 0.75), pick(rng, 0.54, 0.9), pick(rng, 1.3, 1.95)
    skin = palette.of('metal', 'ceramic', 'metal', 'plastic', 'paint')
    parts: list[Part] = [(block((-d / 2, -w / 2, 0.02), (d / 2 - 0.06, w / 2, h)), skin)]
    if w > 0.8:
        panels = [(-w / 2, -0.004, 0.05, h), (0.004, w / 2, 0.05, h)]
    else:
        cut = h * (pick(rng, 0.3, 0.42) if rng.random() < 0.5 else pick(rng, 0.62, 0.75))
        panels = [(-w / 2, w / 2, 0.05, cut - 0.005), (-w / 2, w / 2, cut + 0.005, h)]
    for k, (a, b, low, high) in enumerate(panels):
        parts.append((block((d / 2 - 0.055, a, low), (d / 2, b, high)), skin))
        grip = (b - 0.05 if k == 0 else a + 0.05) if w > 0.8 else a + 0.05
        span = 0.3 * (high - low)
        middle = (low + high) / 2
        parts.append((rod((d / 2 + 0.04, grip, middle - span), (d / 2 + 0.04, grip, middle + span), 0.013, 5), skin))
    return thing('refrigerator', parts)
