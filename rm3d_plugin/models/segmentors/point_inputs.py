"""What the backbone of a segmentor reads of a point (METHOD 7: colour and coordinates)."""

from dataclasses import dataclass
from typing import Literal, get_args

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rm3d_plugin.structures import SceneError
from rm3d_plugin.structures.check_field import check_switches

Column = Literal['intensity', 'rgb', 'shape', 'clearance', 'place']
_WIDTHS = {'intensity': 1, 'rgb': 3, 'shape': 8, 'clearance': 12, 'place': 8}
_FLOOR = 0.01  # share of a scene's points below its floor: stray points do not count


@dataclass(frozen=True)
class PointInputs:
    """Which features a point has.

    Attributes:
        columns: What the scans have behind x, y, z, in the order of the points: intensity, rgb, shape, clearance and
            place (as the transforms ``ShapeFeatures``, ``ClearanceFeatures`` and ``SinusoidalPosition`` append them),
            all in [0, 1].
        use: Those of ``columns`` that the network sees; None: all. Leaving out colour makes a network that colour
            cannot mislead.
        height: Whether it sees the height above the scene's floor.
        coordinates: Whether it sees the horizontal place in the scene.
        height_scale: Metres of height that count 1; usual room height.
        extent: Metres from the scene's middle at which its place counts a half; larger rooms are squeezed, so a hall
            of 100 m stays within [-1, 1].
    """

    columns: tuple[Column, ...] = ('rgb',)
    use: tuple[Column, ...] | None = None
    height: bool = True
    coordinates: bool = True
    height_scale: float = 3.0
    extent: float = 10.0

    def __post_init__(self) -> None:
        check_switches(self, 'height', 'coordinates')
        for name in (*self.columns, *(self.use or ())):
            if name not in get_args(Column):
                raise ValueError(f'PointInputs.columns: expected names out of {get_args(Column)}, got {name!r}')
        if tuple(self.columns) != tuple(name for name in get_args(Column) if name in self.columns):
            raise ValueError(
                'PointInputs.columns: expected intensity before rgb before shape before clearance before place, each '
                f'once, got {self.columns}'
            )
        if not set(self.used) <= set(self.columns):
            raise ValueError(f'PointInputs.use: {self.use} names what columns={self.columns} does not have')
        if not (self.height_scale > 0 and self.extent > 0):
            raise ValueError(f'PointInputs: expected lengths > 0, got {self.height_scale} and {self.extent}')

    @property
    def used(self) -> tuple[Column, ...]:
        """The columns that the network sees."""
        return tuple(self.columns) if self.use is None else tuple(self.use)

    @property
    def point_columns(self) -> int:
        """Columns that the points have, x, y, z included."""
        return 3 + sum(_WIDTHS[name] for name in self.columns)

    @property
    def channels(self) -> int:
        """Columns of :func:`point_inputs`."""
        return sum(_WIDTHS[name] for name in self.used) + self.height + 2 * self.coordinates + 1


def point_inputs(
    points: Float[Tensor, 'points columns'], batch_offsets: Int[Tensor, ' scenes_and_one'], settings: PointInputs
) -> Float[Tensor, 'points channels']:
    """Features of points: intensity, colour and shape in [-1, 1], height, place, and a one.

    Height is measured from the lowest per cent of the scene's points, in units of ``height_scale``, within [-1, 2].
    A place d metres from the median of the scene counts d / (|d| + extent), so neither large rooms nor stray points
    leave the range of training.

    Args:
        points: x, y, z in metres, then ``settings.columns``.
        batch_offsets: Rows of the scenes.
        settings: What to compute.

    Raises:
        SceneError: The points have other columns than ``settings.columns`` says.
    """
    if points.shape[1] != settings.point_columns:
        raise SceneError(
            f'points: {points.shape[1]} columns, but x, y, z and columns={list(settings.columns)} make '
            f'{settings.point_columns}; set inputs.columns of the model (point_columns of a config) to what they have'
        )
    parts, first = [], 3
    for name in settings.columns:
        if name in settings.used:
            parts.append(2.0 * points[:, first : first + _WIDTHS[name]] - 1.0)
        first += _WIDTHS[name]
    bounds = batch_offsets.tolist()
    scenes = [points[a:b, :3] for a, b in zip(bounds[:-1], bounds[1:], strict=True)]
    if settings.height:
        parts.append(torch.cat([_height(xyz[:, 2:], settings.height_scale) for xyz in scenes]))
    if settings.coordinates:
        parts.append(torch.cat([_place(xyz[:, :2], settings.extent) for xyz in scenes]))
    return torch.cat([*parts, torch.ones_like(points[:, :1])], dim=1)


def _height(z: Float[Tensor, 'points 1'], scale: float) -> Float[Tensor, 'points 1']:
    if len(z) == 0:
        return z
    return ((z - _ranked(z, int(_FLOOR * len(z)))) / scale).clamp(-1.0, 2.0)


def _place(xy: Float[Tensor, 'points 2'], extent: float) -> Float[Tensor, 'points 2']:
    if len(xy) == 0:
        return xy
    across = xy - _ranked(xy, len(xy) // 2)
    return across / (across.abs() + extent)


def _ranked(values: Float[Tensor, 'points axes'], rank: int) -> Float[Tensor, ' axes']:
    """Of each column, the value that so many are not above."""
    return values.kthvalue(rank + 1, dim=0).values
