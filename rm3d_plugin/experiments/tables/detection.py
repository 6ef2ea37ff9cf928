"""Boxes from few labels: what each mechanism adds."""

from typing import Any

from rm3d_plugin.experiments.spec import Row, Table, full_row
from rm3d_plugin.experiments.tables.streets import KITTI

LEAF, ALONE, FULL = 'rm3d_votenet_kitti_1pct', 'sup_votenet_kitti_1pct', 'sup_votenet_kitti_full'
PLAIN: dict[str, Any] = {'teacher': None, 'mirror': False, 'iou_head': None, 'iou_loss': None}
PROTOTYPES = {'prototype_loss': '${class_prototypes}'}
MECHANISMS = Table(
    title=f'{KITTI.title}; mechanism by mechanism',
    rows=(
        Row('labelled boxes alone', ALONE, {'iou_head': None, 'iou_loss': None}),
        Row('groups of regions become boxes, best share by round', LEAF, PLAIN),
        Row('predicted boxes become boxes', LEAF, PLAIN | {'teacher': {'recognised': 0.0}}),
        Row('+ IoU head', LEAF, {'mirror': False, 'teacher': {'recognised': 0.0}}),
        Row('+ mirrored view', LEAF, {'teacher': {'recognised': 0.0}}),
        Row('+ classes that are recognised (the default)', LEAF),
        Row('default + reliable background alone', LEAF, {'unlabelled_weight': 0.0}),
        Row('default + boxes fitted to the points', LEAF, {'teacher': {'refit': True}}),
        Row('default + prototypes', LEAF, PROTOTYPES),
        Row('default + pasting of accepted objects', LEAF, {'paste_accepted': True}),
        Row(full_row('votenet'), FULL),
    ),
    scores=KITTI.scores,
    reference=full_row('votenet'),
)
