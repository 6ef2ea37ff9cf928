"""A room of planes, boxes and spheres with the object of every point."""

import numpy as np


def _face(rng, origin, side_a, side_b, density):
    count = int(density * np.linalg.norm(np.cross(side_a, side_b)))
    return origin + rng.uniform(size=(count, 1)) * side_a + rng.uniform(size=(count, 1)) * side_b


def _box(rng, low, size, density):
    low, size = np.array(low, dtype=float), np.array(size, dtype=float)
    x, y, z = np.diag(size)
    faces = [(low, x, z), (low + y, x, z), (low, y, z), (low + x, y, z), (low + z, x, y)]
    return np.concatenate([_face(rng, *face, density) for face in faces])


def _sphere(rng, centre, radius, density):
    direction = rng.normal(size=(int(density * 4 * np.pi * radius**2), 3))
    return centre + radius * direction / np.linalg.norm(direction, axis=1, keepdims=True)


def make_room(seed=0, density=900.0, noise=0.002):
    """Points (N, 3) float32 in metres and their objects: floor 0, walls 1 and 2, boxes 3-5, spheres 6-8."""
    rng = np.random.default_rng(seed)
    x, y, z = np.diag([4.0, 3.0, 2.0])
    zero = np.zeros(3)
    parts = [
        _face(rng, zero, x, y, density),
        _face(rng, zero, x, z, density),
        _face(rng, zero, y, z, density),
        _box(rng, [0.8, 0.8, 0.0], [0.8, 0.6, 0.7], density),
        _box(rng, [2.4, 1.6, 0.0], [0.5, 0.5, 0.4], density),
        _box(rng, [0.5, 2.2, 0.0], [0.6, 0.4, 1.2], density),
        _sphere(rng, np.array([3.2, 0.8, 0.35]), 0.33, density),
        _sphere(rng, np.array([2.0, 2.5, 0.3]), 0.28, density),
        _sphere(rng, np.array([1.2, 1.1, 1.02]), 0.3, density),
    ]
    xyz = np.concatenate(parts)
    labels = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return (xyz + rng.normal(0, noise, xyz.shape)).astype(np.float32), labels
