"""Trees, bushes and hedges of a street: about a fifth of what a lidar sees in real ones."""

from collections.abc import Callable

import numpy as np

from rm3d_plugin.datasets.synthetic import street_furniture
from rm3d_plugin.datasets.synthetic.road_users import pick
from rm3d_plugin.datasets.synthetic.shapes import Mesh
from rm3d_plugin.datasets.synthetic.street_ground import AHEAD, BEHIND, Road

Put = Callable[[Mesh, float, float, float, float | None], bool]


def plant_avenue(put: Put, rng: np.random.Generator, side: float) -> None:
    """Trees along a kerb, a few metres apart."""
    out = float(np.sign(side))
    x = pick(rng, BEHIND + 5, BEHIND + 12)
    share = pick(rng, 0.05, 0.55)
    while x < AHEAD - 10:
        if rng.random() < share:
            put(street_furniture.tree(rng), x, side + out * 0.8, pick(rng, 0, 6.2), 0.5)
        x += pick(rng, 5.0, 11.0)


def plant_garden(put: Put, rng: np.random.Generator, start: float, length: float, edge: float, depth: float) -> None:
    """Bushes and small trees between a boundary and a house.

    Args:
        put: Places a thing.
        rng: Source of randomness.
        start: Where the garden begins along the road, metres.
        length: Metres along the road.
        edge: Offset of its boundary to the pavement.
        depth: Metres to the house.
    """
    out = float(np.sign(edge))
    for _ in range(int(length * depth / 3.0 + rng.random())):
        place, away = start + length * float(rng.random()), edge + out * pick(rng, 0.5, max(depth - 0.4, 0.6))
        maker = street_furniture.tree if rng.random() < 0.2 else street_furniture.bush
        put(maker(rng), place, away, pick(rng, 0, 6.2), None)


def plant_land(put: Put, rng: np.random.Generator, start: float, length: float, edge: float, density: float) -> None:
    """Open land: single bushes and trees to woodland with undergrowth.

    Args:
        put: Places a thing.
        rng: Source of randomness.
        start: Where it begins along the road, metres.
        length: Metres along the road.
        edge: Offset of its border to the pavement.
        density: From 0 (meadow) to 1 (woodland).
    """
    out = float(np.sign(edge))
    for _ in range(int(length * density * 1.1 + rng.random())):
        place = start + length * float(rng.random())
        away = edge + out * (0.8 + 13.0 * float(rng.random()) * float(rng.random()))
        maker = street_furniture.tree if rng.random() < 0.45 else street_furniture.bush
        put(maker(rng), place, away, pick(rng, 0, 6.2), None)
    if rng.random() < 0.5 + 0.5 * density:
        put(street_furniture.thicket(rng, length), start + length / 2, edge + out * pick(rng, 7.0, 18.0), 0.0, None)


def boundary(put: Put, rng: np.random.Generator, middle: float, length: float, edge: float) -> None:
    """What parts a garden from the pavement: mostly hedges, else a wall or a fence."""
    makers = (street_furniture.hedge, street_furniture.hedge, street_furniture.wall, street_furniture.fence)
    put(makers[int(rng.random() * len(makers))](rng, length * 0.9), middle, edge, 0.0, None)


def edge_of(road: Road, side: float) -> float:
    """Offset where gardens begin behind the pavement of a kerb."""
    return side + float(np.sign(side)) * (road.pavement + road.verge)
