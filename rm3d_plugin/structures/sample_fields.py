"""One way to read a sample, be its fields flat as in ``SceneSample`` or nested as in mmdetection3d 1.x.

mmdetection3d packs a scene into a ``Det3DDataSample``: truth for training in ``gt_pts_seg`` and ``gt_instances_3d``,
predictions in ``pred_pts_seg`` and ``pred_instances_3d``, and the truth that metrics compare with in ``eval_ann_info``.
"""

from collections.abc import Iterable, Mapping
from pathlib import PurePath
from typing import Any

from mmengine.structures import BaseDataElement, InstanceData

from rm3d_plugin.structures.boxes3d import box_rows
from rm3d_plugin.structures.point_cloud import SceneError

_BOXES = ('bboxes_3d', 'labels_3d', 'scores_3d')
_NESTED: dict[str, tuple[str, str]] = {
    **{f'gt_{name}': ('gt_instances_3d', name) for name in _BOXES[:2]},
    **{f'pred_{name}': ('pred_instances_3d', name) for name in _BOXES},
    'pts_semantic_mask': ('gt_pts_seg', 'pts_semantic_mask'),
    'pts_instance_mask': ('gt_pts_seg', 'pts_instance_mask'),
    'pred_pts_semantic_mask': ('pred_pts_seg', 'pts_semantic_mask'),
    'pred_instance_masks': ('pred_pts_seg', 'pts_instance_mask'),
    'pred_instance_labels': ('pred_pts_seg', 'instance_labels'),
    'pred_instance_scores': ('pred_pts_seg', 'instance_scores'),
}
"""Field of ``SceneSample`` -> where mmdetection3d keeps it."""
_GROUPS = frozenset(group for group, _ in _NESTED.values())
_TRUTH = ('gt_bboxes_3d', 'gt_labels_3d', 'pts_semantic_mask', 'pts_instance_mask')


def is_nested(sample: Any) -> bool:
    """Whether a sample is laid out as those of mmdetection3d."""
    return any(group in sample for group in _GROUPS)


def sample_fields(sample: Any) -> dict[str, Any]:
    """The fields of a sample by the names of ``SceneSample``; those that are absent or None are left out.

    Args:
        sample: ``SceneSample``, ``Det3DDataSample``, or either as a mapping, as metrics get it.
    """
    flat = {name: value for name, value in _items(sample).items() if value is not None}
    for name, (group, inner) in _NESTED.items():
        value = _items(flat.get(group, {})).get(inner)
        if name not in flat and value is not None:
            flat[name] = value
    if 'scene_id' not in flat and (scene := _scene_of(flat)):
        flat['scene_id'] = scene
    for name in ('gt_bboxes_3d', 'pred_bboxes_3d'):
        if name in flat:
            flat[name] = box_rows(flat[name])
    return flat


def evaluated_fields(sample: Any) -> dict[str, Any]:
    """As :func:`sample_fields`, with the truth of ``eval_ann_info`` where there is one: for metrics alone."""
    flat = sample_fields(sample)
    truth = _items(flat.get('eval_ann_info', {}))
    return flat | {name: box_rows(truth[name]) for name in _TRUTH if truth.get(name) is not None}


def need_known_field(samples: Iterable[Any], known: Iterable[str], reader: str) -> None:
    """Refuse a batch of which nothing can be learnt, as no sample has a field that is read.

    Args:
        samples: From :func:`sample_fields`.
        known: Fields, any of which is enough.
        reader: Who reads them, for the message.

    Raises:
        SceneError: None of the samples has any of the fields.
    """
    each, known = list(samples), list(known)
    if any(name in fields for fields in each for name in known):
        return
    found = sorted({name for fields in each for name in fields if not name.startswith('_')})
    raise SceneError(
        f'{reader}: no sample of the batch has {" or ".join(known)}, so nothing would be learnt; it has '
        f'{", ".join(found) or "no field"}. Expected the fields of SceneSample, or gt_pts_seg and gt_instances_3d as '
        'Pack3DDetInputs of mmdetection3d makes them (keys=[..., "pts_semantic_mask"] or "gt_bboxes_3d", '
        '"gt_labels_3d")'
    )


def nest_predictions(sample: BaseDataElement) -> None:
    """Give a sample of mmdetection3d its predictions in its own layout, too, so that its own metrics read them."""
    if not is_nested(sample):
        return
    if 'pred_bboxes_3d' in sample:
        found = InstanceData(labels_3d=sample.pred_labels_3d, scores_3d=sample.pred_scores_3d)
        found.bboxes_3d = _boxes_like(sample, sample.pred_bboxes_3d)
        sample.pred_instances_3d = found
    if 'pred_point_probs' in sample and 'gt_pts_seg' in sample:
        points = type(sample.gt_pts_seg)()
        points.pts_semantic_mask = sample.pred_point_probs.argmax(dim=1)
        if 'pred_instance_masks' in sample:
            points.set_data({inner: sample.get(name) for name, (_, inner) in _NESTED.items() if 'instance_' in name})
        sample.pred_pts_seg = points


def _boxes_like(sample: BaseDataElement, rows: Any) -> Any:
    given = _items(sample.get('gt_instances_3d')).get('bboxes_3d')
    kind: Any = sample.metainfo.get('box_type_3d') or (None if given is None else type(given))
    return rows if kind is None else kind(rows, box_dim=7, origin=(0.5, 0.5, 0.5))


def _items(element: Any) -> Mapping[str, Any]:
    if isinstance(element, BaseDataElement):
        return dict(element.all_items())
    return element if isinstance(element, Mapping) else {}


def _scene_of(fields: Mapping[str, Any]) -> str:
    """How mmdetection3d names a scene: by its file, else by its number."""
    path = fields.get('lidar_path')
    return PurePath(path).stem if isinstance(path, str) else str(fields.get('sample_idx', ''))
