"""Boxes from few labels: what each mechanism adds."""

from typing import Any

from rm3d_plugin.experiments.spec import Row, Table, full_row
from rm3d_plugin.experiments.tables.streets import KITTI

LEAF, ALONE, FULL = 'rm3d_votenet_kitti_1pct', 'sup_votenet_kitti_1pct', 'sup_votenet_kitti_full'
TEACHER: dict[str, Any] = {'teacher': '${predicted_boxes}'}
IOU: dict[str, Any] = {'iou_head': '${box_iou_head}', 'iou_loss': '${box_overlap}'}
ANY: dict[str, Any] = {'predicted_boxes': {'recognised': 0.0}}
GEOMETRY: dict[str, Any] = {'pseudo_geometry': 1.0}
ONE: dict[str, Any] = {'tta_views': None}
ALL: dict[str, Any] = TEACHER | IOU
MECHANISMS = Table(
    title=f'{KITTI.title}; mechanism by mechanism',
    rows=(
        Row('labelled boxes alone, one view at test time', ALONE, ONE),
        Row('labelled boxes alone', ALONE),
        Row('groups of regions become boxes, best share by round (the default)', LEAF),
        Row('the same, where boxes lie is learnt from pseudo boxes, too', LEAF, GEOMETRY),
        Row(
            'predicted boxes become boxes, where they lie is learnt from them, one view',
            LEAF,
            TEACHER | ANY | ONE | GEOMETRY,
        ),
        Row('+ all views', LEAF, TEACHER | ANY | GEOMETRY),
        Row('+ where boxes lie is learnt from labelled ones alone', LEAF, TEACHER | ANY),
        Row('+ IoU head', LEAF, ALL | ANY),
        Row('+ classes that are recognised alone', LEAF, ALL),
        Row('the same + reliable background alone', LEAF, ALL | {'unlabelled_weight': 0.0}),
        Row('the same + boxes fitted to the points', LEAF, ALL | {'predicted_boxes': {'refit': True}}),
        Row('default + prototypes', LEAF, {'prototype_loss': '${class_prototypes}'}),
        Row('default + pasting of accepted objects', LEAF, {'paste_accepted': True}),
        Row(full_row('votenet'), FULL),
    ),
    scores=KITTI.scores,
    reference=full_row('votenet'),
)
