"""Boxes from few labels: what each mechanism adds."""

from typing import Any

from rm3d_plugin.experiments.spec import Row, Table, full_row
from rm3d_plugin.experiments.tables.streets import KITTI

LEAF, ALONE, FULL = 'rm3d_votenet_kitti_1pct', 'sup_votenet_kitti_1pct', 'sup_votenet_kitti_full'
IOU: dict[str, Any] = {'iou_head': '${box_iou_head}', 'iou_loss': '${box_overlap}'}
GROUPS: dict[str, Any] = {'teacher': None}
GEOMETRY: dict[str, Any] = {'pseudo_geometry': 1.0}
MEAN_TEACHER: dict[str, Any] = {'labels_from': 'teacher', 'method_hook': '${mean_teacher}'}
ONE_VIEW: dict[str, Any] = {'tta_views': None}
AS_IT_COMES: dict[str, Any] = ONE_VIEW | {
    'score_by_points': False,
    'score_by_height': False,
    'on_ground': False,
    'aug_prob': 1.0,
}
MECHANISMS = Table(
    title=f'{KITTI.title}; mechanism by mechanism',
    rows=(
        Row('labelled boxes alone, one view', ALONE, ONE_VIEW),
        Row('labelled boxes alone', ALONE),
        Row('RM3D as in the paper', LEAF, {'strategy': 'paper'} | GEOMETRY | AS_IT_COMES),
        Row('groups of regions become boxes, and teach where boxes lie', LEAF, GROUPS | GEOMETRY),
        Row('groups of regions become boxes', LEAF, GROUPS),
        Row('predicted boxes become boxes (the default)', LEAF),
        Row('default, one view', LEAF, ONE_VIEW),
        Row('default, scores do not ask the points', LEAF, {'score_by_points': False}),
        Row(
            'default, boxes as high as they are predicted, and scores do not ask how far up points reach',
            LEAF,
            {'on_ground': False, 'score_by_height': False},
        ),
        Row('default, they teach where boxes lie', LEAF, GEOMETRY),
        Row('default, also of classes that are not recognised', LEAF, {'predicted_boxes': {'recognised': 0.0}}),
        Row('default, whatever is above them', LEAF, {'predicted_boxes': {'free_above': 0.0}}),
        Row('default, of any height, seen or not', LEAF, {'predicted_boxes': {'top': 0.0}}),
        Row('default, scores do not ask how far up points reach', LEAF, {'score_by_height': False}),
        Row('default, however high they say they are', LEAF, {'predicted_boxes': {'seen_height': 0.0}}),
        Row('default, no descriptor tells what clusters look like', LEAF, {'cluster_descriptor': None}),
        Row('default, looks are not asked', LEAF, {'predicted_boxes': {'least_likeness': 0.0}}),
        Row('default, never more than in the round before', LEAF, {'predicted_boxes': {'growth': 1.0}}),
        Row(
            'default, what is unknown counts as background in part in all rounds',
            LEAF,
            {'predicted_boxes': {'ignore_unknown': False}},
        ),
        Row('default, boxes around instances of classes and votes', LEAF, {'predicted_boxes': {'source': 'instances'}}),
        Row('default, boxes around clusters above the ground', LEAF, {'predicted_boxes': {'source': 'clusters'}}),
        Row('default, labels by a running mean of the network', LEAF, MEAN_TEACHER),
        Row('default + IoU head', LEAF, IOU),
        Row(
            'default, looks are not asked + reliable background alone, from the start',
            LEAF,
            {'unlabelled_weight': 0.0, 'predicted_boxes': {'least_likeness': 0.0}},
        ),
        Row('default + boxes fitted to the points', LEAF, {'predicted_boxes': {'refit': True}}),
        Row('default + prototypes', LEAF, {'prototype_loss': '${class_prototypes}'}),
        Row('default + pasting of accepted objects', LEAF, {'paste_accepted': True}),
        Row(full_row('votenet'), FULL),
    ),
    scores=KITTI.scores,
    reference=full_row('votenet'),
)
