"""Turns of scenes: rotation matrices about an axis."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

TurnKind = Literal['z', 'so3']


def turn_about(axis: Sequence[float] | Float[np.ndarray, '3'], degrees: float) -> Float[np.ndarray, '3 3']:
    """Rotation matrix about an axis through the origin (Rodrigues)."""
    x, y, z = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.deg2rad(degrees)
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


def random_turn(kind: TurnKind, rng: np.random.Generator) -> Float[np.ndarray, '3 3']:
    """A turn by a random angle of 0 to 180 degrees, about z or about an axis of random direction."""
    axis = np.array([0.0, 0.0, 1.0]) if kind == 'z' else rng.normal(size=3)
    return turn_about(axis, rng.uniform(0.0, 180.0))
