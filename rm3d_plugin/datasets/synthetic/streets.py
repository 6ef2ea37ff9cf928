"""Street scenes in the frame of a lidar on a driving car: x ahead, y left, z up, the sensor at the origin.

A street is a gently curved and sloping road with kerbs and pavements, rows of parked cars, traffic, people and
cyclists, and everything else that stands in streets.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from rm3d_plugin.datasets.synthetic import road_users, street_furniture
from rm3d_plugin.datasets.synthetic.road_users import RoadUser, pick
from rm3d_plugin.datasets.synthetic.shapes import Mesh, cos_sin
from rm3d_plugin.datasets.synthetic.street_greens import boundary, edge_of, plant_avenue, plant_garden, plant_land
from rm3d_plugin.datasets.synthetic.street_ground import AHEAD, BEHIND, PARKING, Road, make_ground, random_road

Snap = Callable[[RoadUser, float, float, float, float], tuple[Float[np.ndarray, '3'], float]]


@dataclass(frozen=True, eq=False)
class Placed:
    """A labelled thing in the scene.

    Attributes:
        user: What it is.
        bottom: (3,) middle of its bottom face, metres, sensor frame.
        yaw: Radians counter-clockwise from +x.
        mesh: Its triangles in the sensor frame.
    """

    user: RoadUser
    bottom: Float[np.ndarray, '3']
    yaw: float
    mesh: Mesh


@dataclass(eq=False)
class Street:
    """A scene while it is built, and when it is done.

    Attributes:
        road: The ground's shape.
        placed: Labelled things.
        background: Everything else.
        taken: (x, y, radius) circles that are occupied, metres.
    """

    road: Road
    placed: list[Placed] = field(default_factory=list)
    background: list[Mesh] = field(default_factory=list)
    taken: list[tuple[float, float, float]] = field(default_factory=list)

    def free(self, circles: list[tuple[float, float, float]]) -> bool:
        """Whether none of the circles meets what is there, or the sensor's own car."""
        own = [(-2.0, 0.0, 1.3), (0.0, 0.0, 2.4), (2.0, 0.0, 1.5)]
        return all((x - a) ** 2 + (y - b) ** 2 >= (r + c) ** 2 for x, y, r in circles for a, b, c in self.taken + own)

    def add_user(self, user: RoadUser, x: float, offset: float, turn: float, snap: Snap, gap: float = 0.1) -> bool:
        """Put a labelled thing on the road, turned from the road's heading, if its place is free."""
        px, py = self.road.point(x, offset)
        yaw = self.road.heading(x) + turn
        circles = footprint(user.size, px, py, yaw, gap)
        if not self.free(circles):
            return False
        bottom, yaw = snap(user, px, py, float(self.road.height(x, offset)), yaw)
        self.taken += circles
        self.placed.append(Placed(user, bottom, yaw, user.mesh.moved(bottom, yaw)))
        return True

    def add_thing(self, mesh: Mesh, x: float, offset: float, turn: float, radius: float | None = None) -> bool:
        """Put an unlabelled thing there if its place is free; radius None: no check, nothing occupied."""
        px, py = self.road.point(x, offset)
        if radius is not None:
            if not self.free([(px, py, radius)]):
                return False
            self.taken.append((px, py, radius))
        z = float(self.road.height(x, offset))
        self.background.append(mesh.moved((px, py, z), self.road.heading(x) + turn))
        return True


def footprint(
    size: tuple[float, float, float], x: float, y: float, yaw: float, gap: float = 0.1
) -> list[tuple[float, float, float]]:
    """Circles (x, y, radius) that cover a box seen from above, with a gap around it."""
    length, width = size[0] + 2 * gap, size[1] + 2 * gap
    count = max(1, int(np.ceil(length / width)))
    part = length / count
    radius = 0.5 * float(np.sqrt(part * part + width * width))
    c, s = (float(v) for v in cos_sin(yaw))
    along = [(i + 0.5) * part - length / 2 for i in range(count)]
    return [(x + c * a, y + s * a, radius) for a in along]


def make_street(rng: np.random.Generator, snap: Snap) -> Street:
    """A random street.

    Args:
        rng: Source of randomness.
        snap: Moves a labelled thing, given its plan position, ground height and yaw, to where its label's decimals can
            say exactly; returns the bottom's middle and the yaw.
    """
    street = Street(random_road(rng))
    _park_cars(street, rng, snap)
    _drive_cars(street, rng, snap)
    _ride_bicycles(street, rng, snap)
    _walk_people(street, rng, snap)
    _furnish(street, rng, snap)
    _build(street, rng)
    street.background.append(make_ground(street.road, rng))
    return street


def _any_car(rng: np.random.Generator) -> RoadUser:
    kinds = ('sedan', 'sedan', 'hatchback', 'hatchback', 'hatchback', 'suv', 'suv', 'van')
    return road_users.car(rng, kinds[int(rng.random() * len(kinds))])


def _flip(rng: np.random.Generator, chance: float = 0.5) -> float:
    return float(np.pi) if rng.random() < chance else 0.0


def _park_cars(street: Street, rng: np.random.Generator, snap: Snap) -> None:
    """Rows along the kerbs near the sensor, with gaps of 0.7 to 2 m and empty slots; now and then a car askew."""
    road = street.road
    for parked, kerb, inward in ((road.parked_left, road.left, -1.0), (road.parked_right, road.right, 1.0)):
        filled = pick(rng, 0.3, 0.6)
        x, end = pick(rng, -13.0, -7.0), pick(rng, 9.0, 26.0)
        while parked and x < end:
            user = _any_car(rng)
            askew = pick(rng, -0.3, 0.3) if rng.random() < 0.15 else pick(rng, -0.04, 0.04)
            offset = kerb + inward * (user.size[1] / 2 + pick(rng, 0.15, 0.4))
            if rng.random() < filled:
                turn = askew + (_flip(rng, 0.85) if inward < 0 else _flip(rng, 0.15))
                street.add_user(user, x + user.size[0] / 2, offset, turn, snap, gap=0.05)
            x += user.size[0] + pick(rng, 0.7, 2.0)


def _drive_cars(street: Street, rng: np.random.Generator, snap: Snap) -> None:
    """Traffic ahead and oncoming, some crossing."""
    oncoming = street.road.left - (PARKING if street.road.parked_left else 0.0) - 1.7
    for _ in range(int(rng.random() * 3.2)):
        x = pick(rng, 11.0, 74.0)
        chance = rng.random()
        if chance < 0.5:
            street.add_user(_any_car(rng), x, oncoming + pick(rng, -0.4, 0.4), np.pi + pick(rng, -0.05, 0.05), snap)
        elif chance < 0.85:
            street.add_user(_any_car(rng), x + 4, pick(rng, -0.5, 0.4), pick(rng, -0.06, 0.06), snap)
        else:
            turn = np.pi / 2 + _flip(rng) + pick(rng, -0.5, 0.5)
            street.add_user(_any_car(rng), x + 8, pick(rng, -2.0, oncoming), turn, snap)


def _ride_bicycles(street: Street, rng: np.random.Generator, snap: Snap) -> None:
    """Along the kerbs, in the lane or on the pavement; a few cross."""
    road = street.road
    left = road.left - (PARKING if road.parked_left else 0.0) - 0.7
    right = road.right + (PARKING if road.parked_right else 0.0) + 0.5
    for _ in range(1 + int(rng.random() * 3.3)):
        x, chance = _ahead(rng), rng.random()
        place = (
            left if chance < 0.35 else right if chance < 0.65 else road.left + 1.0 if chance < 0.8 else road.right - 1.0
        )
        turn = (_flip(rng, 0.85) if place > 0 else _flip(rng, 0.2)) + pick(rng, -0.15, 0.15)
        if rng.random() < 0.2:
            turn, place = pick(rng, -np.pi, np.pi), pick(rng, road.right, road.left)
        street.add_user(road_users.cyclist(rng), x, place + pick(rng, -0.3, 0.3), turn, snap)


def _walk_people(street: Street, rng: np.random.Generator, snap: Snap) -> None:
    """On the pavements, some side by side, some crossing the road."""
    road = street.road
    for _ in range(1 + int(rng.random() * 4)):
        x = _ahead(rng)
        side = road.left if rng.random() < 0.5 else road.right
        offset = side + float(np.sign(side)) * pick(rng, 0.5, road.pavement - 0.3)
        turn = _flip(rng) + pick(rng, -0.4, 0.4)
        if rng.random() < 0.25:
            offset, turn = pick(rng, road.right, road.left), pick(rng, -np.pi, np.pi)
        street.add_user(road_users.pedestrian(rng), x, offset, turn, snap, gap=0.02)
        if rng.random() < 0.35:
            beside = offset + pick(rng, 0.75, 0.95)
            street.add_user(road_users.pedestrian(rng), x + pick(rng, -0.3, 0.3), beside, turn, snap, gap=0.02)


def _ahead(rng: np.random.Generator) -> float:
    """A distance ahead, near ones a little more often."""
    return 4.0 + 52.0 * float(rng.random()) * (0.55 + 0.45 * float(rng.random()))


def _furnish(street: Street, rng: np.random.Generator, snap: Snap) -> None:
    """Trees, signs, bins and the like near the kerbs; benches, now and then with someone on them."""
    road = street.road
    for side in (road.left, road.right):
        out = float(np.sign(side))
        plant_avenue(street.add_thing, rng, side)
        for x in np.arange(BEHIND + pick(rng, 0.0, 20.0), AHEAD - 10, pick(rng, 45.0, 70.0)):
            street.add_thing(street_furniture.lamp_post(rng), float(x), side + out * 0.6, 0.0, 0.3)
        for _ in range(12 + int(rng.random() * 14)):
            near = pick(rng, 0.3, 0.9) if rng.random() < 0.5 else pick(rng, 0.9, road.pavement + 0.8)
            turn = pick(rng, -0.3, 0.3) + (np.pi if rng.random() < 0.8 else np.pi / 2)
            place = pick(rng, -12.0, 62.0)
            street.add_thing(street_furniture.small_thing(rng), place, side + out * near, turn, 0.55)
        for _ in range(int(rng.random() * 4)):
            beyond = side + out * (road.pavement + pick(rng, 0.8, 4.0))
            street.add_thing(street_furniture.big_thing(rng), pick(rng, 5.0, 55.0), beyond, pick(rng, -0.4, 0.4), 1.9)
        if rng.random() < 0.25:
            x, back = _ahead(rng), side + out * (road.pavement - 0.5)
            if street.add_thing(street_furniture.bench(rng), x, back, -out * np.pi / 2, 0.9) and rng.random() < 0.5:
                _sit(street, rng, snap, x, back, -out * np.pi / 2)


def _sit(street: Street, rng: np.random.Generator, snap: Snap, x: float, offset: float, turn: float) -> None:
    user = road_users.sitting_person(rng)
    px, py = street.road.point(x, offset)
    yaw = street.road.heading(x) + turn
    c, s = (float(v) for v in cos_sin(yaw))
    bottom, yaw = snap(user, px + 0.12 * c, py + 0.12 * s, float(street.road.height(x, offset)), yaw)
    street.placed.append(Placed(user, bottom, yaw, user.mesh.moved(bottom, yaw)))


def _build(street: Street, rng: np.random.Generator) -> None:
    """Houses behind front gardens, or open land, along the pavements' outer edges."""
    road = street.road
    for side in (road.left, road.right):
        edge = edge_of(road, side)
        open_land = rng.random() < 0.36
        setback, density = pick(rng, 0.0, 3.5), pick(rng, 0.5, 1.2)
        x = BEHIND
        while x < AHEAD - 4:
            length = pick(rng, 5.0, 14.0)
            if not open_land and rng.random() < 0.92:
                _add_house(street, rng, x, length, edge, setback)
            else:
                plant_land(street.add_thing, rng, x, length, edge, density)
            if rng.random() < (0.8 if open_land else 0.5 if setback > 1.0 else 0.0):
                boundary(street.add_thing, rng, x + length / 2, length, edge)
            x += length + (pick(rng, 0.0, 0.4) if rng.random() < 0.7 else pick(rng, 2.0, 7.0))


def _add_house(street: Street, rng: np.random.Generator, x: float, length: float, edge: float, setback: float) -> None:
    out = float(np.sign(edge))
    house = street_furniture.facade(rng, length)
    street.add_thing(house, x + length / 2, edge + out * (setback + 0.4), 0.0 if out > 0 else float(np.pi))
    if setback > 1.0:
        plant_garden(street.add_thing, rng, x, length, edge, setback)
