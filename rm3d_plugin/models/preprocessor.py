"""From a list of scenes to one batch: points end to end, with offsets."""

from typing import Any

import torch
from mmengine.model import BaseDataPreprocessor
from torch import Tensor

from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import SceneError


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

    In: ``inputs`` = dict of lists: ``points`` (n, D) and, with an augmented view, ``aug_points`` (m, D) with
    ``aug_index`` (m,), the row of ``points`` that each augmented point was. Out: ``inputs`` = dict of ``points``
    (N, D), ``batch_offsets`` (B + 1,), and ``aug_points``, ``aug_batch_offsets``, ``aug_index`` (rows of the joined
    ``points``); the latter are left out where no scene of the batch has a point in its augmented view.
    """

    def forward(self, data: Any, training: bool = False) -> dict[str, Any]:
        """Join the scenes of one batch.

        Raises:
            SceneError: An augmented view and its index differ in length, or an index lies outside its scene.
        """
        data = self.cast_data(data)
        inputs = data['inputs']
        points, offsets = join_scenes(inputs['points'])
        joined = {'points': points, 'batch_offsets': offsets}
        if 'aug_points' in inputs:
            self._check_view(inputs)
        if any(len(view) for view in inputs.get('aug_points', ())):
            joined['aug_points'], joined['aug_batch_offsets'] = join_scenes(inputs['aug_points'])
            shifted = [rows + first for rows, first in zip(inputs['aug_index'], offsets[:-1], strict=True)]
            joined['aug_index'] = torch.cat(shifted)
        return {'inputs': joined, 'data_samples': data.get('data_samples')}

    @staticmethod
    def _check_view(inputs: dict[str, list[Tensor]]) -> None:
        views = zip(inputs['points'], inputs['aug_points'], inputs['aug_index'], strict=True)
        for points, view, rows in views:
            if len(view) != len(rows):
                raise SceneError(f'aug_index: expected {len(view)} rows (one an augmented point), got {len(rows)}')
            if len(rows) and not 0 <= int(rows.min()) <= int(rows.max()) < len(points):
                raise SceneError(f'aug_index: expected rows of {len(points)} points, got up to {int(rows.max())}')
