"""Clouds for the geometry benchmarks: a furnished room of any number of points, the same on every machine."""

import argparse
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.ops.morton import morton_order

Order = Literal['random', 'morton']
NOISE = 0.002  # m, standard deviation along the surface's normal
ROOM = (0.0, 0.0, 0.0, 7.0, 5.5, 2.8)  # m, corner and size
FURNITURE = [  # m, corner and size
    (0.5, 0.3, 0.0, 1.8, 0.9, 0.75),
    (4.4, 0.4, 0.0, 1.6, 0.8, 0.75),
    (0.3, 3.9, 0.0, 2.1, 1.5, 0.50),
    (5.9, 2.2, 0.0, 0.9, 2.4, 2.00),
    (3.0, 2.2, 0.0, 0.5, 0.5, 0.90),
    (3.9, 2.9, 0.0, 0.5, 0.5, 0.90),
    (3.4, 4.6, 0.0, 1.2, 0.4, 1.20),
]
SAMPLE = 2000  # points whose neighbours are counted to find a radius


class Room(NamedTuple):
    """A room and the radius that gives its points so many neighbours.

    Attributes:
        xyz: (N, 3) float32 metres.
        radius: Metres.
        neighbors: Mean number of points within the radius, the point itself among them.
    """

    xyz: Float[np.ndarray, 'points 3']
    radius: float
    neighbors: float


def add_arguments(parser: argparse.ArgumentParser, points: int = 100_000) -> None:
    """Options that describe the cloud."""
    parser.add_argument('--points', type=int, default=points, help='points of the room')
    parser.add_argument('--neighbors', type=float, default=30.0, help='mean points within the search radius')
    parser.add_argument('--order', choices=('random', 'morton'), default='random', help='order of points in memory')


def from_arguments(args: argparse.Namespace) -> Room:
    """The room that the options describe.

    Raises:
        ConfigError: It would hold no points.
    """
    if args.points < 1 or not args.neighbors > 0:
        raise ConfigError(f'--points, --neighbors: expected numbers above 0, got {args.points}, {args.neighbors:g}')
    return room(args.points, args.neighbors, args.order)


def room(points: int, neighbors: float = 30.0, order: Order = 'random', seed: int = 0) -> Room:
    """Points spread evenly over walls, floor, ceiling and furniture, with noise, turned by 20 degrees about z.

    Args:
        points: How many.
        neighbors: Mean number of points that the radius is to hold.
        order: In memory: as drawn, or along the Morton curve.
        seed: Of the draw.
    """
    rng = np.random.default_rng(seed)
    boxes = np.array([ROOM, *FURNITURE])
    sizes = boxes[:, 3:]
    area = np.stack([sizes[:, (axis + 1) % 3] * sizes[:, (axis + 2) % 3] for axis in range(3)], axis=1).repeat(
        2, axis=1
    )
    face = rng.choice(area.size, points, p=(area / area.sum()).reshape(-1))
    box, axis, far = face // 6, face % 6 // 2, face % 2
    inside = rng.random((points, 3))
    inside[np.arange(points), axis] = far
    xyz = boxes[box, :3] + inside * sizes[box]
    xyz[np.arange(points), axis] += rng.normal(0.0, NOISE, points)
    cosine, sine = np.cos(np.deg2rad(20.0)), np.sin(np.deg2rad(20.0))
    xyz = (xyz @ np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])).astype(np.float32)
    if order == 'morton':
        xyz = np.ascontiguousarray(xyz[morton_order(xyz)])
    return Room(xyz, *_radius_for(xyz, neighbors, float(area.sum())))


def _radius_for(xyz: Float[np.ndarray, 'points 3'], neighbors: float, area: float) -> tuple[float, float]:
    """The radius (to a tenth of a millimetre) nearest to the wanted mean, and the mean on a sample of the points."""
    tree, sample = cKDTree(xyz), xyz[:: max(len(xyz) // SAMPLE, 1)]
    low, high = 0.0, 4.0 * float(np.sqrt(neighbors * area / (np.pi * len(xyz))))
    while high - low > 1e-4:
        middle = (low + high) / 2
        mean = float(tree.query_ball_point(sample, middle, return_length=True).mean())
        low, high = (middle, high) if mean < neighbors else (low, middle)
    radius = round(high, 4)
    return radius, float(tree.query_ball_point(sample, radius, return_length=True).mean())
