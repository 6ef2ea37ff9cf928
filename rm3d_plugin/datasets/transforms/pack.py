"""From arrays to what a model takes."""

from typing import Any

import numpy as np
import torch

from rm3d_plugin.registry import TRANSFORMS
from rm3d_plugin.structures import SceneSample

# results name -> field of SceneSample and its type
_FIELDS = {
    'point_index': ('point_index', np.int64),
    'boxes': ('gt_bboxes_3d', np.float32),
    'box_labels': ('gt_labels_3d', np.int64),
    'box_is_annotated': ('gt_is_annotated', np.bool_),
    'semantic': ('pts_semantic_mask', np.int64),
    'instance': ('pts_instance_mask', np.int64),
    'is_annotated': ('pts_is_annotated', np.bool_),
    'confidence': ('pts_confidence', np.float32),
    'region': ('pts_region', np.int64),
    'ground_height': ('pts_height', np.float32),
}


def pack_scene(results: dict[str, Any]) -> dict[str, Any]:
    """Turn an item into tensors.

    Returns:
        ``inputs``: dict of float32 ``points`` (n, channels) and, with further views, ``views``: a list of dicts of
        float32 ``points`` (m, channels) and int64 ``point_ids`` (m,), the rows of the first view that they copy.
        ``data_samples``: a :class:`SceneSample`; fields whose arrays are absent are absent; metainfo scene_id,
        num_points and, for metrics, annotation.
    """
    inputs: dict[str, Any] = {'points': _tensor(results['points'], np.float32)}
    if 'views' in results:
        inputs['views'] = [
            {'points': _tensor(view.points, np.float32), 'point_ids': _tensor(view.point_ids, np.int64)}
            for view in results['views']
        ]
    sample = SceneSample(metainfo={'scene_id': results['scene_id'], 'num_points': results['num_points']})
    if results.get('annotation') is not None:
        sample.set_metainfo({'annotation': results['annotation']})
    for name, (field, dtype) in _FIELDS.items():
        if name in results:
            sample.set_data({field: _tensor(results[name], dtype)})
    return {'inputs': inputs, 'data_samples': sample}


def _tensor(array: np.ndarray, dtype: type) -> torch.Tensor:
    return torch.from_numpy(np.array(array, dtype=dtype, order='C'))


@TRANSFORMS.register_module()
class PackScene:
    """The last transform of every pipeline."""

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Pack."""
        return pack_scene(results)
