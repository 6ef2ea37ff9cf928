"""What every descriptor is, and what they share: normals to work with, region means, similarity."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal, Self, final

import numpy as np
from jaxtyping import Float

from rm3d_plugin.ops.normals import estimate_normals
from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.ops.viewpoint import virtual_viewpoint as virtual_viewpoint
from rm3d_plugin.storage.fingerprint import Fingerprinted
from rm3d_plugin.structures import Descriptors, PointCloud


def cosine_similarity(
    first: Float[np.ndarray, 'pairs features'], second: Float[np.ndarray, 'pairs features']
) -> Float[np.ndarray, ' pairs']:
    """Cosine between rows, clipped to [0, 1]; 0 where a row is zero (not described).

    Scaling a row changes nothing, so histograms need no renormalising before.

    Raises:
        ValueError: The shapes differ.

    Examples:
        >>> cosine_similarity(np.array([[1.0, 0.0], [1.0, 1.0]]), np.array([[2.0, 0.0], [-1.0, -1.0]]))
        array([1., 0.])
    """
    if first.shape != second.shape or first.ndim != 2:
        raise ValueError(f'cosine_similarity: expected two arrays (P, F), got {first.shape} and {second.shape}')
    a, b = first.astype(np.float64), second.astype(np.float64)
    norms = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    return np.clip((a * b).sum(axis=1) / np.where(norms > 0, norms, 1.0), 0.0, 1.0)


def growing_radii(cloud: PointCloud, radius: float, range_growth: float) -> Float[np.ndarray, ' points']:
    """Search radius of each point: ``radius * max(1, range_growth * distance)``, metres.

    Args:
        cloud: The distance is to its sensor, or to the local origin where no sensor is known.
        radius: Metres near the sensor.
        range_growth: Per metre; 0 keeps the radius the same everywhere.
    """
    sensor = np.zeros(3) if cloud.sensor is None else np.asarray(cloud.sensor)
    distance = np.linalg.norm(cloud.xyz - sensor, axis=1)
    return radius * np.maximum(1.0, range_growth * distance)


def cloud_normals(cloud: PointCloud, k: int, octree: Octree | None = None) -> Float[np.ndarray, 'points 3']:
    """The cloud's normals, or estimates turned to the sensor; float32, zero where there is none.

    Args:
        cloud: Its ``normals`` are used where it has them. Without a sensor estimates turn to :func:`virtual_viewpoint`.
        k: Nearest points that an estimate uses.
        octree: Over the cloud's points, where there is one already.
    """
    if cloud.normals is not None:
        return cloud.normals
    viewpoint = virtual_viewpoint(cloud.xyz) if cloud.sensor is None else np.asarray(cloud.sensor, dtype=np.float64)
    estimate = estimate_normals(cloud.xyz, k=k, viewpoint=viewpoint, octree=octree)
    return np.where(estimate.valid[:, None], estimate.normals, np.float32(0))


class Descriptor(Fingerprinted, ABC):
    """Turns a cloud into one feature vector a point. Subclasses are final and registered in ``DESCRIPTORS``.

    Caches name what it makes by its :meth:`fingerprint`: settings and weights are its public attributes.

    Attributes:
        presets: Kind of scene -> arguments that suit it; empty where the defaults serve everywhere.
    """

    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}

    @final
    @classmethod
    def preset(cls, name: Literal['indoor', 'lidar']) -> Self:
        """The descriptor with the numbers that suit a kind of scene.

        Raises:
            ValueError: It has no such preset.
        """
        if name not in cls.presets:
            raise ValueError(f'{cls.__name__}.preset: expected one of {sorted(cls.presets)}, got {name!r}')
        return cls(**cls.presets[name])

    def for_scene(self, scene: str) -> 'Descriptor':  # noqa: ARG002
        """The descriptor of a scene: itself, unless it reads a file of each."""
        return self

    def scene_file(self, scene: str) -> Path | None:  # noqa: ARG002
        """The file that is read for a scene; None: none is."""
        return None

    @abstractmethod
    def compute(self, cloud: PointCloud) -> Descriptors:
        """Describe every point of a cloud.

        Args:
            cloud: The scene.

        Returns:
            Values and validity, one row a point.
        """
