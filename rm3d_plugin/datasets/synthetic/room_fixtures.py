"""What hangs on walls or is part of them: doors, windows, curtains, pictures, boards, radiators.

Their frame: the wall is the plane x = 0 and the room lies at x > 0; recesses reach to x < 0.
"""

import numpy as np

from rm3d_plugin.datasets.synthetic.road_users import pick
from rm3d_plugin.datasets.synthetic.room_materials import PLAIN, Palette
from rm3d_plugin.datasets.synthetic.room_things import Part, Thing, block, rod, thing, wavy_sheet
from rm3d_plugin.datasets.synthetic.shapes import Mesh

RECESS = 0.16  # m, thickness of walls at doors and windows


def door(rng: np.random.Generator, palette: Palette, w: float, h: float) -> Thing:
    """A leaf with panels and a handle in a frame, closed, or ajar into the room."""
    leaf, frame = palette.of('wood', 'paint', 'paint', 'metal'), palette.of('wood', 'paint')
    if rng.random() < 0.5:
        frame = leaf
    jamb, deep = pick(rng, 0.04, 0.09), pick(rng, 0.02, 0.12)
    parts: list[Part] = []
    for y in (-w / 2, w / 2 - jamb):
        parts.append((block((-RECESS, y, 0.0), (0.015, y + jamb, h)), frame))
    parts.append((block((-RECESS, -w / 2, h - jamb), (0.015, w / 2, h)), frame))
    half = w / 2 - jamb
    body: list[Part] = [(block((-0.04, -2 * half, 0.005), (0.0, 0.0, h - jamb)), leaf)]
    if rng.random() < 0.5:
        rows = 1 + int(rng.random() * 3)
        tall = (h - 0.3) / rows
        for i in range(rows):
            low = 0.12 + i * tall
            body.append((block((0.0, -2 * half + 0.12, low), (0.012, -0.12, low + tall - 0.1)), leaf))
    if rng.random() < 0.2:
        pane = palette.of('glass')
        body.append((block((0.001, -2 * half + 0.15, 1.2), (0.006, -0.15, h - jamb - 0.15)), pane))
    body.append((rod((0.05, -2 * half + 0.07, 1.02), (0.05, -2 * half + 0.19, 1.02), 0.012), palette.of('metal')))
    if rng.random() < 0.2:  # ajar: turned about its hinge into the room
        turn = pick(rng, 0.25, 1.4)
        parts += [(piece.moved((0.0, half, 0.0), turn), material) for piece, material in body]
        parts.append((block((-RECESS - 0.02, -w / 2, 0.0), (-RECESS, w / 2, h)), frame))
    else:
        parts += [(piece.moved((-deep, half, 0.0)), material) for piece, material in body]
    return thing('door', parts)


def window(rng: np.random.Generator, palette: Palette, w: float, h: float) -> Thing:
    """Frame, bars, glass that mostly returns nothing, and a sill; its lower edge is at z = 0."""
    frame = palette.of('paint', 'wood', 'plastic', 'metal')
    bar, deep = pick(rng, 0.04, 0.08), pick(rng, 0.04, 0.12)
    x = (-deep - 0.05, -deep)
    parts: list[Part] = [(block((x[0], a, 0.0), (x[1], a + bar, h)), frame) for a in (-w / 2, w / 2 - bar)]
    parts += [(block((x[0], -w / 2, z), (x[1], w / 2, z + bar)), frame) for z in (0.0, h - bar)]
    columns, rows = 1 + int(rng.random() * 3), 1 + int(rng.random() * 2.2)
    parts += [
        (
            block(
                (x[0], -w / 2 + w * i / columns - bar / 2, 0.0), (x[1] - 0.01, -w / 2 + w * i / columns + bar / 2, h)
            ),
            frame,
        )
        for i in range(1, columns)
    ]
    parts += [
        (block((x[0], -w / 2, h * i / rows - bar / 2), (x[1] - 0.01, w / 2, h * i / rows + bar / 2)), frame)
        for i in range(1, rows)
    ]
    glass = palette.of('glass')
    if rng.random() < 0.35:  # frosted, or blinds behind: the glass is seen
        glass = palette.of('paint', 'fabric')._replace(dropout=0.15)
    parts.append((block((x[0] + 0.01, -w / 2, 0.0), (x[0] + 0.02, w / 2, h)), glass))
    if rng.random() < 0.6:
        parts.append((block((-deep, -w / 2, -0.01), (pick(rng, 0.02, 0.15), w / 2, 0.025)), frame))
    return thing('window', parts)


def curtain(
    rng: np.random.Generator, palette: Palette, spans: list[tuple[float, float]], low: float, high: float
) -> Thing:
    """Cloths over spans of y, with folds, from a rod."""
    cloth = palette.of('fabric', 'fabric', 'paint')
    off, swing = pick(rng, 0.07, 0.12), pick(rng, 0.02, 0.045)
    parts: list[Part] = []
    for a, b in spans:
        waves = max(1.5, (b - a) / pick(rng, 0.1, 0.22))
        sheet = wavy_sheet(b - a, low, high, waves, swing, pick(rng, 0, 6.2))
        parts.append((sheet.moved((off, (a + b) / 2, 0.0)), cloth))
    ends = spans[0][0] - 0.08, spans[-1][1] + 0.08
    parts.append((rod((off, ends[0], high + 0.01), (off, ends[1], high + 0.01), 0.014), palette.of('metal', 'wood')))
    return thing('curtain', parts)


def shower_curtain(rng: np.random.Generator, palette: Palette, width: float, low: float, high: float) -> Thing:
    """A hanging cloth along y at x = 0, open at one side."""
    drawn = pick(rng, 0.35, 0.95) * width
    side = -1.0 if rng.random() < 0.5 else 1.0
    sheet = wavy_sheet(drawn, low, high, drawn / pick(rng, 0.12, 0.25), pick(rng, 0.02, 0.05), pick(rng, 0, 6.2))
    cloth = palette.of('fabric', 'plastic', 'paint', 'print')
    bar = rod((0.0, -width / 2, high + 0.01), (0.0, width / 2, high + 0.01), 0.014)
    return thing(
        'shower curtain', [(sheet.moved((0.0, side * (width - drawn) / 2, 0.0)), cloth), (bar, palette.of('metal'))]
    )


def _board(w: float, h: float, rim: float, thick: float, raised: float) -> tuple[Mesh, list[Mesh]]:
    """A panel and its frame; lower edge at z = 0."""
    panel = block((0.0, -w / 2, 0.0), (thick, w / 2, h))
    frame = [block((0.0, y, 0.0), (thick + raised, y + rim, h)) for y in (-w / 2, w / 2 - rim)]
    frame += [block((0.0, -w / 2, z), (thick + raised, w / 2, z + rim)) for z in (0.0, h - rim)]
    return panel, frame


def picture(rng: np.random.Generator, palette: Palette, w: float, h: float) -> Thing:
    """A poster, a canvas or a framed picture."""
    panel, frame = _board(w, h, pick(rng, 0.015, 0.06), pick(rng, 0.008, 0.03), pick(rng, 0.004, 0.02))
    image = palette.of('print', 'print', 'fabric', 'paint')
    parts: list[Part] = [(panel, image)]
    if rng.random() < 0.7:
        wood = palette.of('wood', 'plastic', 'metal')
        parts += [(body, wood) for body in frame]
    return thing('picture', parts)


def whiteboard(rng: np.random.Generator, palette: Palette, w: float, h: float) -> Thing:
    """White, green or cork, with a ledge."""
    panel, frame = _board(w, h, 0.025, 0.015, 0.008)
    face = palette.of('ceramic', 'ceramic', 'plastic', 'paint')._replace(pattern=PLAIN)
    rim = palette.of('metal', 'wood', 'plastic')
    parts: list[Part] = [(panel, face), *((body, rim) for body in frame)]
    parts.append((block((0.0, -w / 3, 0.0), (0.08, w / 3, 0.02)), rim))
    return thing('whiteboard', parts)


def mirror(rng: np.random.Generator, palette: Palette, w: float, h: float) -> Thing:
    """Glass in a frame: mostly a hole in a scan."""
    panel, frame = _board(w, h, 0.03, 0.01, 0.006)
    rim = palette.of('metal', 'wood')
    return thing('mirror', [(panel, palette.of('glass')), *((body, rim) for body in frame)])


def television(rng: np.random.Generator, palette: Palette, w: float) -> Thing:
    """A flat screen on the wall."""
    panel, frame = _board(w, 0.58 * w, 0.02, 0.05, 0.004)
    rim = palette.of('plastic')
    return thing('tv', [(panel, palette.of('screen')), *((body, rim) for body in frame)])


def radiator(rng: np.random.Generator, palette: Palette, w: float) -> Thing:
    """Ribs between two bars, a hand's width from the wall."""
    h, low, deep = pick(rng, 0.4, 0.7), pick(rng, 0.06, 0.15), pick(rng, 0.06, 0.12)
    skin = palette.of('paint', 'metal', 'ceramic')
    parts: list[Part] = [(block((0.05, -w / 2, z), (0.05 + deep, w / 2, z + 0.04)), skin) for z in (low, low + h)]
    count = max(3, int(w / pick(rng, 0.06, 0.12)))
    for i in range(count):
        y = -w / 2 + w * (i + 0.5) / count
        parts.append((block((0.05, y - 0.02, low), (0.05 + deep, y + 0.02, low + h)), skin))
    parts += [(block((0.05, y, 0.0), (0.08, y + 0.02, low)), skin) for y in (-w / 2, w / 2 - 0.02)]
    return thing('radiator', parts)
