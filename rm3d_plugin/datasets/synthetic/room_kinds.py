"""Kinds of rooms: which furniture a room of each kind holds and how it is arranged."""

from collections.abc import Callable

import numpy as np

from rm3d_plugin.datasets.synthetic import room_clutter as clutter
from rm3d_plugin.datasets.synthetic import room_fixtures as fixtures
from rm3d_plugin.datasets.synthetic import room_layout as plan
from rm3d_plugin.datasets.synthetic import room_seats as seats
from rm3d_plugin.datasets.synthetic import room_storage as storage
from rm3d_plugin.datasets.synthetic import room_tables as tables
from rm3d_plugin.datasets.synthetic.road_users import pick
from rm3d_plugin.datasets.synthetic.room_filling import add_clutter, ahead, lay_clutter, line_walls, wall_thing
from rm3d_plugin.datasets.synthetic.room_layout import HALF_TURN, Layout, Pose, Rect, footprint
from rm3d_plugin.datasets.synthetic.room_materials import USUAL_COLORS, USUAL_SHARE, Palette, in_usual_color
from rm3d_plugin.datasets.synthetic.room_things import CATEGORIES, Thing

# Metres: length, width, height.
_SIZES = {
    'office': ((5.6, 7.6), (3.0, 4.0), (2.4, 2.8)),
    'bedroom': ((5.4, 7.0), (3.0, 3.9), (2.4, 2.7)),
    'kitchen': ((5.4, 7.0), (2.4, 3.0), (2.4, 2.7)),
    'bathroom': ((5.0, 6.2), (1.9, 2.6), (2.3, 2.6)),
    'living': ((6.2, 8.2), (3.2, 4.2), (2.4, 2.8)),
    'studio': ((6.4, 8.4), (3.2, 4.1), (2.4, 2.7)),
    'conference': ((6.0, 8.0), (2.9, 3.6), (2.5, 3.0)),
    'hallway': ((6.5, 9.5), (1.5, 2.1), (2.4, 2.9)),
}


def random_layout(rng: np.random.Generator, kind: str, structure: float) -> Layout:
    """A furnished room.

    Args:
        rng: Source of randomness.
        kind: One of ROOM_KINDS.
        structure: Chance of a column, and of beams under the ceiling.
    """
    if kind not in ROOM_KINDS:
        raise ValueError(f'kind: expected one of {", ".join(ROOM_KINDS)}, got {kind!r}')
    length, width, height = (round(pick(rng, *bounds), 3) for bounds in _SIZES[kind])
    layout = Layout(kind, (length, width, height), rng, Palette(rng))
    if min(length, width) > 3.0 and rng.random() < 0.25:
        plan.add_corner(layout)
    if rng.random() < structure and width > 2.4:
        plan.add_column(layout)
    if rng.random() < structure:
        plan.add_beams(layout)
    plan.add_door(layout)
    _FURNISH[kind](layout)
    if kind != 'bathroom' and length * width > 18 and rng.random() < 0.35:
        _FURNISH[kind](layout)  # a long room has two zones
    line_walls(layout)
    add_clutter(layout)
    plan.close_shell(layout, wet=kind == 'bathroom')
    layout.things = [_as_usual(item, rng) for item in layout.things]
    return layout


def _as_usual(item: Thing, rng: np.random.Generator) -> Thing:
    """Most things have the colour that most things of their class have."""
    usual = USUAL_COLORS.get(CATEGORIES[item.name].nyu40_name)
    if usual is None or rng.random() >= USUAL_SHARE:
        return item
    parts = tuple((body, in_usual_color(material, usual, rng)) for body, material in item.parts)
    return Thing(item.name, parts, item.tops)


def _seat_at(layout: Layout, pose: Pose, item: Thing, below: Rect) -> None:
    """A chair that may reach under a table; pushed in by chance, a little turned."""
    rng = layout.rng
    layout.stand([item], ahead(pose, pick(rng, -0.22, 0.03), 0.0, pick(rng, -0.35, 0.35)), below=below)


def _add_desk(layout: Layout) -> None:
    rng, palette = layout.rng, layout.palette
    item = tables.desk(rng, palette)
    pose = (
        layout.against_wall([item], tries=40) if rng.random() < 0.8 else layout.somewhere([item], margin=0.6, tries=40)
    )
    if pose is None:
        return
    lay_clutter(layout, pose, item.tops, 1.5)
    depth, height = item.tops[0].x[1] + 0.15, item.tops[0].z
    for i in range(int(rng.random() * 2.6)):
        layout.put(
            [clutter.monitor(rng, palette)], ahead(pose, -0.12, (-0.3, 0.32)[i % 2], pick(rng, -0.3, 0.3)), height
        )
    if rng.random() < 0.85:
        kind = seats.office_chair if rng.random() < 0.7 else seats.chair
        below = footprint([item], pose)
        at = next((rect for rect in layout.taken if rect == below), below)
        _seat_at(layout, ahead(pose, depth + 0.3, pick(rng, -0.2, 0.2), HALF_TURN), kind(rng, palette), at)


def _add_table(layout: Layout, places: int, wall: float = 0.3) -> None:
    """A table with chairs of one make around it."""
    rng, palette = layout.rng, layout.palette
    item = tables.table(rng, palette, places)
    pose = (
        layout.against_wall([item])
        if rng.random() < wall
        else layout.somewhere([item], margin=0.6, tries=50, straight=0.8)
    )
    if pose is None:
        return
    lay_clutter(layout, pose, item.tops, 1.5)
    below = layout.taken[-1]
    low, high = item.bounds
    spots = [(float(high[0]) + 0.25, y, HALF_TURN) for y in _spread(float(high[1] - low[1]))]
    spots += [(float(low[0]) - 0.25, y, 0.0) for y in _spread(float(high[1] - low[1]))]
    spots += [(0.0, float(high[1]) + 0.25, -HALF_TURN / 2), (0.0, float(low[1]) - 0.25, HALF_TURN / 2)]
    make = (seats.four_leg_chair, seats.cantilever_chair, seats.office_chair)[int(rng.random() * 3)]
    state = rng.integers(1 << 30)
    for x, y, turn in spots:
        if rng.random() < 0.75:
            twin = np.random.Generator(np.random.PCG64(int(state)))
            _seat_at(layout, ahead(pose, x, y, turn), make(twin, Palette(twin)), below)


def _spread(width: float) -> list[float]:
    count = max(1, int(width / 0.62))
    return [(-0.5 + (i + 0.5) / count) * width for i in range(count)]


def _hang_pictures(layout: Layout, most: int) -> None:
    rng = layout.rng
    for _ in range(1 + int(rng.random() * most)):
        w, h = pick(rng, 0.25, 1.2), pick(rng, 0.25, 0.9)
        layout.hang(fixtures.picture(rng, layout.palette, w, h), pick(rng, 1.0, 1.55))


def _add_radiator(layout: Layout) -> None:
    layout.against_wall([fixtures.radiator(layout.rng, layout.palette, pick(layout.rng, 0.5, 1.3))], gap=0.0)


def _add_tv(layout: Layout) -> None:
    rng = layout.rng
    layout.hang(fixtures.television(rng, layout.palette, pick(rng, 0.7, 1.3)), pick(rng, 0.9, 1.4))


def _office(layout: Layout) -> None:
    rng, palette = layout.rng, layout.palette
    for _ in range(1 + int(rng.random() * 2)):
        plan.add_window(layout, curtains=0.25)
    if rng.random() < 0.6:
        layout.hang(fixtures.whiteboard(rng, palette, pick(rng, 1.0, 2.2), pick(rng, 0.8, 1.2)), pick(rng, 0.8, 1.0))
    for _ in range(1 + int(rng.random() * 3)):
        _add_desk(layout)
    for maker, most in ((storage.bookshelf, 2.4), (storage.cabinet, 2.8)):
        for _ in range(int(rng.random() * most + 0.5)):
            wall_thing(layout, maker(rng, palette))
    if rng.random() < 0.6:
        _add_table(layout, 4)
    if rng.random() < 0.4:
        wall_thing(layout, seats.sofa(rng, palette))
    if rng.random() < 0.4:
        layout.somewhere([seats.armchair(rng, palette)])
    if rng.random() < 0.5:
        _add_radiator(layout)
    _hang_pictures(layout, 3)


def _bedroom(layout: Layout) -> None:
    rng, palette = layout.rng, layout.palette
    _add_bed(layout)
    plan.add_window(layout, curtains=0.85)
    if rng.random() < 0.8:
        wall_thing(layout, storage.wardrobe(rng, palette))
    for maker, chance in (
        (storage.dresser, 0.4),
        (storage.cabinet, 0.5),
        (storage.bookshelf, 0.6),
        (seats.armchair, 0.35),
    ):
        if rng.random() < chance:
            wall_thing(layout, maker(rng, palette))
    if rng.random() < 0.9:
        _add_desk(layout)
    if rng.random() < 0.3:
        wall_thing(layout, seats.sofa(rng, palette))
    if rng.random() < 0.35:
        layout.somewhere([seats.ottoman(rng, palette)])
    if rng.random() < 0.4:
        layout.hang(fixtures.mirror(rng, palette, pick(rng, 0.4, 0.8), pick(rng, 0.8, 1.4)), pick(rng, 0.4, 0.8))
    if rng.random() < 0.5:
        _add_radiator(layout)
    _hang_pictures(layout, 3)


def _add_bed(layout: Layout) -> None:
    rng, palette = layout.rng, layout.palette
    group = seats.bed(rng, palette)
    pose = layout.against_wall(group, tries=30)
    if pose is None:
        return
    if rng.random() < 0.3:
        lay_clutter(layout, pose, group[0].tops, 0.7)
    low, high = group[0].bounds
    for side in (-1.0, 1.0):
        if rng.random() < 0.7:
            item = storage.nightstand(rng, palette)
            spot = ahead(pose, float(low[0]) + 0.25, side * (float(high[1]) + 0.32))
            if layout.stand([item], spot):
                lay_clutter(layout, spot, item.tops, 0.8)


def _add_kitchen_row(layout: Layout, width: float, sink: bool = True) -> bool:
    rng, palette = layout.rng, layout.palette
    group = tables.kitchen_row(rng, palette, width, sink)
    pose = layout.against_wall(group, gap=0.0, tries=24)
    if pose is None:
        return False
    for item in group:
        lay_clutter(layout, pose, item.tops, 2.0)
    return True


def _kitchen(layout: Layout) -> None:
    rng, palette = layout.rng, layout.palette
    placed = any(_add_kitchen_row(layout, width) for width in (pick(rng, 1.8, 2.6), 1.5, 1.0))
    layout.against_wall([storage.refrigerator(rng, palette)], tries=30)
    if placed and rng.random() < 0.45:
        _add_kitchen_row(layout, pick(rng, 0.8, 1.6), sink=False)
    plan.add_window(layout, curtains=0.3, small=rng.random() < 0.4)
    if rng.random() < 0.95:
        _add_table(layout, 4, wall=0.5)
    if rng.random() < 0.4:
        wall_thing(layout, storage.cabinet(rng, palette))
    if rng.random() < 0.5:
        _add_radiator(layout)
    _hang_pictures(layout, 2)


def _bathroom(layout: Layout) -> None:
    rng, palette = layout.rng, layout.palette
    longest = max(layout.size[:2])
    for length in (pick(rng, 1.45, 1.75), 1.35):
        tub = tables.bathtub(rng, palette, min(length, longest - 0.1))
        group = [tub]
        if rng.random() < 0.9:
            edge, high = float(tub.bounds[1][0]), pick(rng, 1.85, 2.1)
            cloth = fixtures.shower_curtain(rng, palette, length - 0.02, pick(rng, 0.12, 0.4), high)
            group.append(cloth.moved((edge - 0.06, 0.0, 0.0)))
        if layout.against_wall(group, gap=0.0, tries=30):
            break
    layout.against_wall([seats.toilet(rng, palette)], tries=30)
    pose = layout.against_wall(tables.vanity(rng, palette), tries=30)
    if rng.random() < 0.6:
        layout.hang(fixtures.mirror(rng, palette, pick(rng, 0.4, 0.8), pick(rng, 0.5, 0.9)), 1.1)
    if rng.random() < 0.6:
        plan.add_window(layout, curtains=0.3, small=True)
    if pose is None or rng.random() < 0.4:
        wall_thing(layout, storage.cabinet(rng, palette))
    if rng.random() < 0.5:
        _add_radiator(layout)
    if rng.random() < 0.4:
        _hang_pictures(layout, 1)


def _lounge(layout: Layout) -> None:
    """Sofa, coffee table before it, armchairs."""
    rng, palette = layout.rng, layout.palette
    item = seats.sofa(rng, palette)
    pose = (
        layout.against_wall([item], tries=40) if rng.random() < 0.75 else layout.somewhere([item], margin=0.6, tries=50)
    )
    if pose is None:
        return
    if rng.random() < 0.4:
        lay_clutter(layout, pose, item.tops, 0.5)
    if rng.random() < 0.85:
        low = tables.coffee_table(rng, palette)
        spot = ahead(pose, float(item.bounds[1][0]) + 0.35 - float(low.bounds[0][0]), pick(rng, -0.2, 0.2))
        if layout.stand([low], spot):
            lay_clutter(layout, spot, low.tops, 1.5)


def _living(layout: Layout) -> None:
    rng, palette = layout.rng, layout.palette
    for _ in range(1 + int(rng.random() * 2)):
        plan.add_window(layout, curtains=0.7)
    _lounge(layout)
    if rng.random() < 0.5:
        layout.against_wall([seats.sofa(rng, palette)])
    for maker, chance in (
        (storage.tv_stand, 0.6),
        (storage.bookshelf, 0.7),
        (storage.cabinet, 0.5),
        (storage.bookshelf, 0.3),
    ):
        if rng.random() < chance:
            wall_thing(layout, maker(rng, palette))
    for maker, chance in ((seats.armchair, 0.7), (seats.ottoman, 0.5), (seats.armchair, 0.3)):
        if rng.random() < chance:
            layout.somewhere([maker(rng, palette)])
    if rng.random() < 0.5:
        _add_desk(layout)
    if rng.random() < 0.8:
        _add_table(layout, 4)
    if rng.random() < 0.6:
        _add_tv(layout)
    if rng.random() < 0.4:
        _add_radiator(layout)
    _hang_pictures(layout, 4)


def _studio(layout: Layout) -> None:
    rng, palette = layout.rng, layout.palette
    _add_bed(layout)
    _add_kitchen_row(layout, pick(rng, 1.3, 1.9))
    plan.add_window(layout, curtains=0.7)
    layout.against_wall([storage.refrigerator(rng, palette)])
    if rng.random() < 0.9:
        _lounge(layout)
    if rng.random() < 0.9:
        _add_desk(layout)
    if rng.random() < 0.65:
        wall_thing(layout, storage.bookshelf(rng, palette))
    if rng.random() < 0.5:
        wall_thing(layout, storage.wardrobe(rng, palette))
    if rng.random() < 0.7:
        _add_table(layout, 4)
    _hang_pictures(layout, 3)


def _conference(layout: Layout) -> None:
    rng, palette = layout.rng, layout.palette
    for _ in range(1 + int(rng.random() * 2)):
        plan.add_window(layout, curtains=0.35)
    _add_table(layout, 8, wall=0.0)
    if rng.random() < 0.75:
        layout.hang(fixtures.whiteboard(rng, palette, pick(rng, 1.2, 2.4), pick(rng, 0.9, 1.3)), pick(rng, 0.8, 1.0))
    if rng.random() < 0.5:
        _add_tv(layout)
    for maker, chance in ((storage.cabinet, 0.6), (storage.bookshelf, 0.35), (storage.cabinet, 0.3), (seats.sofa, 0.5)):
        if rng.random() < chance:
            wall_thing(layout, maker(rng, palette))
    for _ in range(int(rng.random() * 3)):
        layout.against_wall([seats.chair(rng, palette)], gap=0.08)
    if rng.random() < 0.5:
        _add_radiator(layout)
    _hang_pictures(layout, 2)


def _hallway(layout: Layout) -> None:
    rng, palette = layout.rng, layout.palette
    for _ in range(1 + int(rng.random() * 3)):
        plan.add_door(layout)
    if rng.random() < 0.4:
        plan.add_window(layout, curtains=0.3)
    for maker, chance in (
        (storage.cabinet, 0.7),
        (storage.bookshelf, 0.5),
        (seats.four_leg_chair, 0.5),
        (seats.armchair, 0.3),
    ):
        if rng.random() < chance:
            wall_thing(layout, maker(rng, palette))
    if rng.random() < 0.5:
        _add_radiator(layout)
    if rng.random() < 0.3:
        layout.hang(fixtures.whiteboard(rng, palette, pick(rng, 0.8, 1.4), pick(rng, 0.6, 1.0)), 0.95)
    _hang_pictures(layout, 5)


_FURNISH: dict[str, Callable[[Layout], None]] = {
    'office': _office, 'bathroom': _bathroom, 'bedroom': _bedroom, 'kitchen': _kitchen, 'living': _living,
    'studio': _studio, 'conference': _conference, 'hallway': _hallway,
}  # fmt: skip
ROOM_KINDS = tuple(_FURNISH)
