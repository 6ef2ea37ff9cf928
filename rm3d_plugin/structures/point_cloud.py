"""The raw scene: points with whatever the sensor gave along."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.user_error import UserError


class SceneError(UserError):
    """Data that cannot be used; the message names the file or field, what was expected and what to do."""


def _channel(name: str, value: np.ndarray | None, shape: tuple[int, ...]) -> np.ndarray | None:
    if value is None:
        return None
    array = np.ascontiguousarray(value, dtype=np.float32)
    if array.shape != shape:
        raise SceneError(f'PointCloud.{name}: expected shape {shape}, got {array.shape}')
    return array


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points of one scene in a local frame, z up.

    Large coordinates (UTM, say) lose nothing: pass the float64 points to :meth:`from_world`, which moves them to a
    local frame and keeps the shift in ``origin``.

    Attributes:
        xyz: (N, 3) float32 metres, local frame, z up.
        colors: (N, 3) float32 in [0, 1], or None.
        intensity: (N,) float32 return strength, or None.
        normals: (N, 3) float32 unit normals, or None.
        curvature: (N,) float32 in [0, 1/3], or None.
        origin: (3,) float64; world = xyz + origin.
        sensor: (3,) float64 sensor position in the local frame, or None where unknown.

    Raises:
        SceneError: A shape does not fit, or a coordinate is NaN or infinite.
    """

    xyz: Float[np.ndarray, 'points 3']
    colors: Float[np.ndarray, 'points 3'] | None = None
    intensity: Float[np.ndarray, ' points'] | None = None
    normals: Float[np.ndarray, 'points 3'] | None = None
    curvature: Float[np.ndarray, ' points'] | None = None
    origin: Float[np.ndarray, '3'] | tuple[float, float, float] = (0.0, 0.0, 0.0)
    sensor: Float[np.ndarray, '3'] | tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        xyz = np.ascontiguousarray(self.xyz, dtype=np.float32)
        if xyz.ndim != 2 or xyz.shape[1] != 3:
            raise SceneError(f'PointCloud.xyz: expected shape (N, 3), got {xyz.shape}')
        bad = int((~np.isfinite(xyz).all(axis=1)).sum())
        if bad:
            raise SceneError(f'PointCloud.xyz: {bad} of {len(xyz)} points are NaN or infinite; drop them first')
        n = len(xyz)
        fields = {
            'xyz': xyz,
            'colors': _channel('colors', self.colors, (n, 3)),
            'intensity': _channel('intensity', self.intensity, (n,)),
            'normals': _channel('normals', self.normals, (n, 3)),
            'curvature': _channel('curvature', self.curvature, (n,)),
            'origin': np.asarray(self.origin, dtype=np.float64),
            'sensor': None if self.sensor is None else np.asarray(self.sensor, dtype=np.float64),
        }
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    @classmethod
    def from_world(cls, xyz: Float[np.ndarray, 'points 3'], **channels: np.ndarray) -> 'PointCloud':
        """Build from float64 world coordinates: the rounded median becomes the origin."""
        world = np.asarray(xyz, dtype=np.float64)
        origin = np.round(np.median(world, axis=0)) if len(world) else np.zeros(3)
        return cls(xyz=(world - origin).astype(np.float32), origin=origin, **channels)

    def __len__(self) -> int:
        return len(self.xyz)

    def select(self, index: Int[np.ndarray, ' kept'] | np.ndarray) -> 'PointCloud':
        """The cloud of the points that ``index`` (integers or a boolean mask) names, in that order."""

        def take(values: np.ndarray | None) -> np.ndarray | None:
            return None if values is None else values[index]

        return PointCloud(
            xyz=self.xyz[index],
            colors=take(self.colors),
            intensity=take(self.intensity),
            normals=take(self.normals),
            curvature=take(self.curvature),
            origin=self.origin,
            sensor=self.sensor,
        )
