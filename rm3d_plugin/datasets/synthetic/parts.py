"""What the triangles of a synthetic street are, for data sets that label points."""

from enum import IntEnum

import numpy as np
from jaxtyping import Float, Int


class Part(IntEnum):
    """Kinds of surface; each native format merges them in its own way."""

    OBJECT = 0  # whatever has no name of its own: bins, cabinets, containers, benches
    ROAD = 1
    PARKING = 2
    SIDEWALK = 3
    TERRAIN = 4
    BUILDING = 5
    WALL = 6
    FENCE = 7
    VEGETATION = 8
    CROWN = 9  # of a tree
    TRUNK = 10
    POLE = 11
    SIGN = 12
    TRAFFIC_LIGHT = 13
    GUARDRAIL = 14
    CAR = 15
    VAN = 16
    TRUCK = 17
    TRAILER = 18
    BICYCLE = 19
    MOTORCYCLE = 20
    PERSON = 21
    BICYCLIST = 22
    MOTORCYCLIST = 23


# Usual colours, 0 to 255; several where things of a kind differ. Colours of different kinds overlap, as in streets.
_COLORS: dict[Part, tuple[tuple[int, int, int], ...]] = {
    Part.OBJECT: ((90, 96, 90), (60, 90, 60), (150, 120, 80), (110, 110, 115)),
    Part.ROAD: ((96, 96, 98),),
    Part.PARKING: ((104, 102, 100),),
    Part.SIDEWALK: ((134, 130, 124),),
    Part.TERRAIN: ((96, 116, 62), (124, 112, 80)),
    Part.BUILDING: ((176, 160, 138), (150, 140, 134), (168, 104, 84), (196, 190, 176)),
    Part.WALL: ((150, 142, 130), (140, 96, 80)),
    Part.FENCE: ((126, 100, 72), (110, 112, 108)),
    Part.VEGETATION: ((72, 104, 48), (90, 112, 60)),
    Part.CROWN: ((68, 102, 46), (104, 112, 54)),
    Part.TRUNK: ((92, 78, 62),),
    Part.POLE: ((120, 122, 124), (92, 94, 92)),
    Part.SIGN: ((180, 60, 56), (60, 84, 160), (200, 196, 190)),
    Part.TRAFFIC_LIGHT: ((52, 54, 50),),
    Part.GUARDRAIL: ((150, 152, 154),),
    Part.CAR: ((40, 42, 46), (170, 172, 174), (120, 30, 34), (44, 60, 110), (214, 214, 212)),
    Part.VAN: ((210, 210, 206), (60, 66, 80), (150, 30, 30)),
    Part.TRUCK: ((190, 190, 186), (60, 90, 140), (180, 120, 50)),
    Part.TRAILER: ((120, 120, 120), (90, 70, 60)),
    Part.BICYCLE: ((50, 52, 56), (140, 40, 40)),
    Part.MOTORCYCLE: ((46, 46, 50), (150, 36, 36)),
    Part.PERSON: ((70, 74, 96), (130, 60, 60), (60, 60, 60), (150, 140, 120)),
    Part.BICYCLIST: ((80, 84, 70), (150, 70, 60), (60, 70, 110)),
    Part.MOTORCYCLIST: ((50, 50, 54), (110, 40, 40)),
}


def paint(
    part: Int[np.ndarray, ' points'],
    owner: Int[np.ndarray, ' points'],
    rng: np.random.Generator,
    grain: float = 12.0,
) -> Int[np.ndarray, 'points 3']:
    """Colours of points: one paint and one light for each thing, a grain for each point.

    Args:
        part: :class:`Part` of each point.
        owner: The thing that each point lies on, numbered from 0.
        rng: Source of randomness.
        grain: Half width of the grain and of the spread between things, in steps of 255.

    Returns:
        (N, 3) int64 in 0 to 255.
    """
    things = int(owner.max()) + 1 if len(owner) else 0
    choice, light = rng.random(things), 0.75 + 0.4 * rng.random(things)
    shift = grain * (2 * rng.random((things, 3)) - 1)
    base = np.zeros((len(part), 3))
    for kind, colors in _COLORS.items():
        of_kind = np.flatnonzero(part == kind)
        pick = (choice[owner[of_kind]] * len(colors)).astype(np.int64)
        base[of_kind] = np.asarray(colors, dtype=np.float64)[pick]
    noise = grain * (2 * rng.random((len(part), 3)) - 1)
    color: Float[np.ndarray, 'points 3'] = base * light[owner, None] + shift[owner] + noise
    return np.clip(np.round(color), 0, 255).astype(np.int64)
