"""Boxes from few labels: what each mechanism adds."""

from typing import Any

from rm3d_plugin.experiments.spec import Row, Table, full_row
from rm3d_plugin.experiments.tables.streets import KITTI

LEAF, ALONE, FULL = 'rm3d_votenet_kitti_1pct', 'sup_votenet_kitti_1pct', 'sup_votenet_kitti_full'
TEACHER: dict[str, Any] = {'teacher': '${predicted_boxes}'}
IOU: dict[str, Any] = {'iou_head': '${box_iou_head}', 'iou_loss': '${box_overlap}'}
ANY: dict[str, Any] = {'predicted_boxes': {'recognised': 0.0}}
ALL: dict[str, Any] = TEACHER | IOU | {'mirror': True}
MECHANISMS = Table(
    title=f'{KITTI.title}; mechanism by mechanism',
    rows=(
        Row('labelled boxes alone', ALONE),
        Row('groups of regions become boxes, best share by round (the default)', LEAF),
        Row('predicted boxes become boxes', LEAF, TEACHER | ANY),
        Row('+ IoU head', LEAF, TEACHER | ANY | IOU),
        Row('+ mirrored view', LEAF, ALL | ANY),
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
