"""The shell of a room and where things may stand or hang in it.

Room frame: metres, z up, the floor is z = 0, the walls are x = 0, x = length, y = 0 and y = width.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from rm3d_plugin.datasets.synthetic import room_fixtures as fixtures
from rm3d_plugin.datasets.synthetic.road_users import pick
from rm3d_plugin.datasets.synthetic.room_materials import Lamp, Palette
from rm3d_plugin.datasets.synthetic.room_things import Thing, block, holed_sheet, thing
from rm3d_plugin.datasets.synthetic.shapes import cos_sin, join, quads

TOUCH = 0.006  # m between things that touch
DOOR_CLEAR = 0.75  # m in front of a door that stay free
HALF_TURN = float(np.pi)


class Rect(NamedTuple):
    """A turned rectangle seen from above: middle, half sides, yaw."""

    x: float
    y: float
    half_x: float
    half_y: float
    yaw: float

    def corners(self) -> list[tuple[float, float]]:
        """Its four corners."""
        c, s = (float(v) for v in cos_sin(self.yaw))
        signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
        return [
            (self.x + c * a * self.half_x - s * b * self.half_y, self.y + s * a * self.half_x + c * b * self.half_y)
            for a, b in signs
        ]


class Span(NamedTuple):
    """A rectangle on a wall: from .. to along it, from .. to in height."""

    start: float
    end: float
    low: float
    high: float

    def meets(self, other: 'Span') -> bool:
        """Whether two rectangles overlap."""
        return self.start < other.end and other.start < self.end and self.low < other.high and other.low < self.high


class Pose(NamedTuple):
    """Where a thing's origin stands."""

    x: float
    y: float
    yaw: float


def overlap(a: Rect, b: Rect) -> bool:
    """Whether two turned rectangles overlap (separating axes)."""
    reach = (a.half_x**2 + a.half_y**2) ** 0.5 + (b.half_x**2 + b.half_y**2) ** 0.5
    if (a.x - b.x) ** 2 + (a.y - b.y) ** 2 > reach * reach:
        return False  # the circles around them are apart
    pa, pb = a.corners(), b.corners()
    for yaw in (a.yaw, b.yaw):
        c, s = (float(v) for v in cos_sin(yaw))
        for ax, ay in ((c, s), (-s, c)):
            da, db = [x * ax + y * ay for x, y in pa], [x * ax + y * ay for x, y in pb]
            if max(da) <= min(db) or max(db) <= min(da):
                return False
    return True


@dataclass(eq=False)
class Layout:
    """A room while it is furnished, and when it is done.

    Attributes:
        kind: Its kind, as 'office'.
        size: (length, width, height) metres.
        rng: Source of randomness.
        palette: Its colours.
        things: What is in it, in the room frame.
        taken: Floor areas that are occupied.
        spans: For each wall, what is on it or before it.
        openings: For each wall, its holes, along the wall.
        lamps: Its lights.
    """

    kind: str
    size: tuple[float, float, float]
    rng: np.random.Generator
    palette: Palette
    things: list[Thing] = field(default_factory=list)
    taken: list[Rect] = field(default_factory=list)
    spans: list[list[Span]] = field(default_factory=lambda: [[], [], [], []])
    openings: list[list[Span]] = field(default_factory=lambda: [[], [], [], []])
    lamps: list[Lamp] = field(default_factory=list)

    def wall_length(self, wall: int) -> float:
        """Walls 0 and 2 run along x, 1 and 3 along y."""
        return self.size[wall % 2]

    def wall_pose(self, wall: int, along: float, off: float = 0.0) -> Pose:
        """A place at a wall, heading into the room."""
        length, width, _ = self.size
        if wall == 0:
            return Pose(along, off, HALF_TURN / 2)
        if wall == 1:
            return Pose(length - off, along, HALF_TURN)
        if wall == 2:
            return Pose(length - along, width - off, -HALF_TURN / 2)
        return Pose(off, width - along, 0.0)

    def free(self, rect: Rect, gap: float = 0.02) -> bool:
        """Whether a floor area is inside the room and nothing stands there."""
        length, width, _ = self.size
        inside = all(-1e-6 <= x <= length + 1e-6 and -1e-6 <= y <= width + 1e-6 for x, y in rect.corners())
        wide = rect._replace(half_x=rect.half_x + gap, half_y=rect.half_y + gap)
        return inside and not any(overlap(wide, other) for other in self.taken)

    def put(self, group: Sequence[Thing], pose: Pose, z: float = 0.0) -> None:
        """Add things there without any check."""
        self.things += [item.moved((pose.x, pose.y, z), pose.yaw) for item in group]

    def stand(self, group: Sequence[Thing], pose: Pose, gap: float = 0.005, below: Rect | None = None) -> bool:
        """Put a group on the floor if its place is free; ``below`` is an area that it may reach into."""
        rect = footprint(group, pose)
        taken = self.taken
        if below is not None:
            self.taken = [other for other in taken if other is not below]
        free = self.free(rect, gap)
        self.taken = taken
        if free:
            self.taken.append(rect)
            self.put(group, pose)
        return free

    def against_wall(
        self, group: Sequence[Thing], gap: float = 0.0, wall: int | None = None, tries: int = 14
    ) -> Pose | None:
        """Put a group with its back to a wall, somewhere free."""
        rng = self.rng
        low, high = join([body for item in group for body, _ in item.parts]).bounds
        half = max(-low[1], high[1])
        for _ in range(tries):
            side = int(rng.random() * 4) if wall is None else wall
            room = self.wall_length(side) - 2 * half
            along = self._along(side, half, room)
            span = Span(along - half, along + half, 0.0, float(high[2]))
            pose = self.wall_pose(side, along, gap + pick(rng, 0.0, 0.03) - float(low[0]))
            if room < 0.04 or any(span.meets(other) for other in self.spans[side]):
                continue
            if self.stand(group, pose):
                self.spans[side].append(span)
                return pose
        return None

    def _along(self, side: int, half: float, room: float) -> float:
        """A place along a wall: anywhere, in a corner, or touching what stands there already."""
        rng = self.rng
        chance, which, after = rng.random(), rng.random(), rng.random() < 0.5
        standing = [span for span in self.spans[side] if span.low < 0.3]
        if chance < 0.45 and standing:
            span = standing[int(which * len(standing))]
            return span.end + half + TOUCH if after else span.start - half - TOUCH
        if chance < 0.65:
            return half + (TOUCH if after else room - TOUCH)
        return half + which * room

    def somewhere(
        self, group: Sequence[Thing], tries: int = 14, margin: float = 0.0, straight: float = 0.6
    ) -> Pose | None:
        """Put a group anywhere on the free floor; ``straight`` is the chance that it is parallel to the walls."""
        rng = self.rng
        for _ in range(tries):
            x, y = pick(rng, margin, self.size[0] - margin), pick(rng, margin, self.size[1] - margin)
            yaw = int(rng.random() * 4) * HALF_TURN / 2 + pick(rng, -0.08, 0.08)
            if rng.random() > straight:
                yaw = pick(rng, -HALF_TURN, HALF_TURN)
            if self.stand(group, Pose(x, y, yaw)):
                return Pose(x, y, yaw)
        return None

    def hang(self, item: Thing, low: float, wall: int | None = None, tries: int = 12) -> bool:
        """Hang a thing on a wall with its lower edge at a height."""
        rng = self.rng
        least, most = item.bounds
        half, top = float(most[1]), low + float(most[2] - least[2])
        for _ in range(tries):
            side = int(rng.random() * 4) if wall is None else wall
            room = self.wall_length(side) - 2 * half
            if room < 0.1 or top > self.size[2]:
                continue
            along = half + pick(rng, 0.05, room - 0.05)
            span = Span(along - half, along + half, low, top)
            if not any(span.meets(other) for other in self.spans[side]):
                self.spans[side].append(span)
                self.put([item], self.wall_pose(side, along), low)
                return True
        return False

    def open_wall(
        self, span_width: float, low: float, high: float, wall: int | None = None, clear: float = 0.0
    ) -> tuple[int, float] | None:
        """Cut a hole into a wall; returns the wall and the hole's middle along it."""
        rng = self.rng
        for _ in range(16):
            side = int(rng.random() * 4) if wall is None else wall
            room = self.wall_length(side) - span_width
            if room < 0.3:
                continue
            along = span_width / 2 + pick(rng, 0.12, room - 0.12)
            span = Span(along - span_width / 2, along + span_width / 2, low, high)
            wide = span._replace(start=span.start - 0.1, end=span.end + 0.1, low=0.0, high=9.0)
            pose = self.wall_pose(side, along, clear / 2)
            rect = Rect(pose.x, pose.y, clear / 2, span_width / 2, pose.yaw)
            if any(wide.meets(other) for other in self.spans[side]) or (clear and not self.free(rect)):
                continue
            if clear:
                self.taken.append(rect)
            self.spans[side].append(span)
            self.openings[side].append(span)
            return side, along
        return None


def footprint(group: Sequence[Thing], pose: Pose) -> Rect:
    """The floor area under a group."""
    low, high = join([body for item in group for body, _ in item.parts]).bounds
    c, s = (float(v) for v in cos_sin(pose.yaw))
    mx, my = (float(v) for v in ((low + high) / 2)[:2])
    half = (high - low) / 2
    return Rect(pose.x + c * mx - s * my, pose.y + s * mx + c * my, float(half[0]), float(half[1]), pose.yaw)


# ------------------------------------------------------------------ the shell


def add_door(layout: Layout, wall: int | None = None) -> None:
    """A door with free floor before it."""
    rng = layout.rng
    w, h = pick(rng, 0.82, 1.05), pick(rng, 2.0, 2.15)
    found = layout.open_wall(w, 0.0, h, wall, DOOR_CLEAR)
    if found is not None:
        layout.put([fixtures.door(rng, layout.palette, w, h)], layout.wall_pose(*found))


def add_window(layout: Layout, curtains: float = 0.4, small: bool = False) -> None:
    """A window, with curtains by chance, and its daylight."""
    rng, (_, _, height) = layout.rng, layout.size
    w, low = (pick(rng, 0.5, 0.8), pick(rng, 1.2, 1.5)) if small else (pick(rng, 0.8, 2.0), pick(rng, 0.45, 1.05))
    h = min(pick(rng, 0.9, 1.6), height - low - 0.2)
    if small:
        h = min(h, 0.7)
    found = layout.open_wall(w, low, low + h)
    if found is None:
        return
    pose = layout.wall_pose(*found)
    layout.put([fixtures.window(rng, layout.palette, w, h)], pose, low)
    strength = pick(rng, 0.2, 0.9)
    c, s = (float(v) for v in cos_sin(pose.yaw))
    layout.lamps.append(
        Lamp((pose.x + 0.3 * c, pose.y + 0.3 * s, low + h / 2), (strength * 0.9, strength, strength * 1.1))
    )
    if rng.random() < curtains:
        _add_curtains(layout, found, w, low, low + h)


def _add_curtains(layout: Layout, at: tuple[int, float], w: float, low: float, high: float) -> None:
    rng, (side, along) = layout.rng, at
    top = min(high + pick(rng, 0.05, 0.25), layout.size[2] - 0.04)
    bottom = pick(rng, 0.02, 0.1) if rng.random() < 0.6 else max(low - 0.15, 0.05)
    reach = min(w / 2 + pick(rng, 0.1, 0.3), along - 0.02, layout.wall_length(side) - along - 0.02)
    share = pick(rng, 0.25, 0.7) * reach
    spans = [(-reach, -reach + share), (reach - share, reach)]
    if rng.random() < 0.25:
        spans = [(-reach, reach)]
    elif rng.random() < 0.25:
        spans = spans[:1]
    cloth = fixtures.curtain(rng, layout.palette, spans, bottom, top)
    layout.put([cloth], layout.wall_pose(side, along))
    layout.spans[side].append(Span(along - reach, along + reach, bottom, top))
    pose = layout.wall_pose(side, along, 0.08)
    layout.taken.append(Rect(pose.x, pose.y, 0.08, reach, pose.yaw))


def add_corner(layout: Layout) -> None:
    """Fill a corner, so that the room has the shape of an L."""
    rng, (length, width, height) = layout.rng, layout.size
    a, b = pick(rng, 0.5, 0.35 * length), pick(rng, 0.5, 0.35 * width)
    x = 0.0 if rng.random() < 0.5 else length - a
    y = 0.0 if rng.random() < 0.5 else width - b
    _fill(layout, 'wall', (x, x + a), (y, y + b), (0.0, height))


def add_column(layout: Layout) -> None:
    """A square column at a wall or away from it."""
    rng, (length, width, height) = layout.rng, layout.size
    half = pick(rng, 0.1, 0.22)
    along = pick(rng, 0.8, length - 0.8)
    y = half if rng.random() < 0.4 else width - half if rng.random() < 0.6 else pick(rng, 0.8, width - 0.8)
    if layout.free(Rect(along, y, half, half, 0.0)):
        _fill(layout, 'column', (along - half, along + half), (y - half, y + half), (0.0, height))


def _fill(layout: Layout, name: str, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> None:
    layout.things.append(
        thing(name, [(block((x[0], y[0], z[0]), (x[1], y[1], z[1])), layout.palette.of('paint', 'paint', 'stone'))])
    )
    layout.taken.append(Rect((x[0] + x[1]) / 2, (y[0] + y[1]) / 2, (x[1] - x[0]) / 2, (y[1] - y[0]) / 2, 0.0))
    length, width, _ = layout.size
    for wall, touches, start, end in (
        (0, y[0] < 0.01, x[0], x[1]),
        (1, x[1] > length - 0.01, y[0], y[1]),
        (2, y[1] > width - 0.01, length - x[1], length - x[0]),
        (3, x[0] < 0.01, width - y[1], width - y[0]),
    ):
        if touches:
            layout.spans[wall].append(Span(start, end, *z))


def add_beams(layout: Layout) -> None:
    """Beams under the ceiling, along the shorter side."""
    rng, (length, width, height) = layout.rng, layout.size
    material = layout.palette.of('paint', 'stone', 'wood')
    thick, deep = pick(rng, 0.1, 0.3), pick(rng, 0.12, 0.35)
    for _ in range(1 + int(rng.random() * 2)):
        at = pick(rng, 0.4, max(length, width) - 0.6)
        low, high = ((at, 0.0), (at + thick, width)) if length > width else ((0.0, at), (length, at + thick))
        body = block((low[0], low[1], height - deep), (high[0], high[1], height))
        layout.things.append(thing('beam', [(body, material)]))


def close_shell(layout: Layout, wet: bool = False) -> None:
    """Floor, ceiling and walls, with the holes that were cut."""
    rng, palette, (length, width, height) = layout.rng, layout.palette, layout.size
    plane = np.array([[[0.0, 0, 0], [length, 0, 0], [length, width, 0], [0, width, 0]]])
    ground = palette.of('tile', 'stone') if wet else palette.of('wood', 'wood', 'fabric', 'tile', 'stone')
    shell = [thing('floor', [(quads(plane, 0.5), ground)])]
    shell.append(thing('ceiling', [(quads(plane + np.array([0, 0, height]), 0.5), palette.of('paint'))]))
    paint, accent = palette.of('tile', 'paint') if wet else palette.of('paint'), int(rng.random() * 8)
    for wall in range(4):
        holes = sorted(layout.openings[wall])
        sheet = holed_sheet(layout.wall_length(wall), height, holes, fixtures.RECESS)
        pose = layout.wall_pose(wall, 0.0)
        skin = palette.of('paint', 'wood', 'stone') if wall == accent else paint
        shell.append(thing('wall', [(sheet.moved((pose.x, pose.y, 0.0), pose.yaw - HALF_TURN / 2), skin)]))
    layout.things[:0] = shell
    for _ in range(1 + int(length * width > 14)):
        warm, strength = pick(rng, 0.75, 1.05), pick(rng, 0.5, 1.3)
        place = (pick(rng, 0.25, 0.75) * length, pick(rng, 0.25, 0.75) * width, height - 0.25)
        layout.lamps.append(Lamp(place, (strength, strength * (0.5 + 0.5 * warm), strength * warm)))
