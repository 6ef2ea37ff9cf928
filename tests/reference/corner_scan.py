"""A floor and a wall that meet, with the true class of each point."""

import numpy as np

FLOOR, WALL = 0, 1
ROWS = 30


def corner(origin=(0.0, 0.0, 0.0)):
    """(1800, 3) float64 metres, and their classes."""
    grid = np.stack(np.meshgrid(np.arange(ROWS), np.arange(ROWS)), axis=-1).reshape(-1, 2) * 0.1
    rough = np.random.default_rng(0).normal(0.0, 0.003, (2, len(grid)))
    floor = np.column_stack([grid, rough[0]])
    wall = np.column_stack([grid[:, 0], 3.0 + rough[1], grid[:, 1] + 0.1])
    return np.concatenate([floor, wall]) + origin, np.repeat([FLOOR, WALL], len(grid))


def few(semantic, each, seed=0):
    """Numbers of so many points of each class."""
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.choice(np.flatnonzero(semantic == own), each, replace=False) for own in (FLOOR, WALL)])


def write_clicks_csv(path, scene, points, semantic, names=('floor', 'wall')):
    """A file of clicks by number."""
    rows = [f'{scene},{point},{names[semantic[point]]}' for point in points.tolist()]
    path.write_text('\n'.join(['scene,index,class', *rows]) + '\n')
    return path
