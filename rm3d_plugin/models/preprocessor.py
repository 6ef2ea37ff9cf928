"""From a list of scenes to one batch: points end to end, with offsets."""

from collections.abc import Mapping
from typing import Any

import torch
from mmengine.model import BaseDataPreprocessor
from torch import Tensor

from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import SceneError
from rm3d_plugin.user_error import UserError


def join_scenes(parts: list[Tensor]) -> tuple[Tensor, Tensor]:
    """Concatenate the rows of scenes.

    Returns:
        All rows, and the (B + 1,) int64 offsets of the scenes among them.

    Raises:
        SceneError: The scenes of a batch have different columns.
    """
    if len(widths := {part.shape[1] for part in parts}) > 1:
        raise SceneError(
            f'points: scenes of {" and ".join(map(str, sorted(widths)))} columns in one batch; expected colour and '
            'intensity in all scenes or in none'
        )
    offsets = torch.tensor([0] + [len(part) for part in parts], device=parts[0].device).cumsum(0)
    return torch.cat(parts), offsets


@MODELS.register_module()
class ScenePreprocessor(BaseDataPreprocessor):
    """Moves a collated batch to the model's device and concatenates its scenes.

    In: ``inputs`` = dict of ``points``, a list of (n, D), and, with further views, ``views``: a list of dicts of
    ``points``, a list of (m, D), and ``point_ids``, a list of (m,): the row of its scene's points that each point of
    the view is, or -1. Out: ``inputs`` = dict of ``points`` (N, D), ``batch_offsets`` (B + 1,) and ``views``, a list of
    dicts of ``points``, ``batch_offsets`` and ``point_ids`` (rows of the joined ``points``, or -1). A view in which no
    scene of the batch has a point is left out. Batches of mmdetection3d (``Pack3DDetInputs``) are such batches, and
    their samples are left as they are.
    """

    def forward(self, data: Any, training: bool = False) -> dict[str, Any]:
        """Join the scenes of one batch.

        Raises:
            UserError: The pipeline does not pack its scenes.
            SceneError: A view and its point ids differ in length, or an id lies outside its scene.
        """
        data = self.cast_data(data)
        if 'inputs' not in data:
            raise UserError(f'pipeline: hands out {", ".join(sorted(data))}, no inputs; it must end with PackScene')
        return {'inputs': join_inputs(data['inputs']), 'data_samples': data.get('data_samples')}


def join_inputs(inputs: Mapping[str, Any]) -> dict[str, Any]:
    """Join the scenes of a batch and those of its views; see :class:`ScenePreprocessor`.

    Raises:
        SceneError: There are no points, or a view does not fit.
    """
    if not isinstance(parts := inputs.get('points'), list | tuple) or not parts:
        raise SceneError(
            f'inputs.points: expected a list of (n, D) tensors, one a scene, got {type(parts).__name__}; use '
            'collate_fn=dict(type="pseudo_collate")'
        )
    points, offsets = join_scenes(list(parts))
    given = enumerate(inputs.get('views', ()))
    views = [_joined_view(view, offsets, f'views[{i}]') for i, view in given if any(map(len, view['points']))]
    return {'points': points, 'batch_offsets': offsets, 'views': views}


def _joined_view(view: dict[str, list[Tensor]], offsets: Tensor, name: str) -> dict[str, Tensor]:
    """One view of all scenes, its ids counted through the batch."""
    for points, ids, size in zip(view['points'], view['point_ids'], offsets.diff().tolist(), strict=True):
        if len(points) != len(ids):
            raise SceneError(f'{name}.point_ids: expected {len(points)} ids (one a point), got {len(ids)}')
        if len(ids) and not -1 <= int(ids.min()) <= int(ids.max()) < size:
            raise SceneError(
                f'{name}.point_ids: expected rows of {size} points, or -1, got {int(ids.min())} to {int(ids.max())}'
            )
    points, batch_offsets = join_scenes(view['points'])
    firsts = zip(view['point_ids'], offsets[:-1], strict=True)
    point_ids = torch.cat([torch.where(ids < 0, ids, ids + first) for ids, first in firsts])
    return {'points': points, 'batch_offsets': batch_offsets, 'point_ids': point_ids}
