"""Boxes from few labels: what each mechanism adds, and the rows of the paper's ablations."""

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
MERGED: dict[str, Any] = {'teacher': None}  # regions and their terms decide about boxes there alone
ABLATIONS = Table(
    title=f"{KITTI.title}; the rows of the paper's ablations",
    rows=(
        Row('everything, groups of regions become boxes', LEAF, MERGED),
        Row('without L_Seg', LEAF, MERGED | {'point_loss': None, 'aug_loss': None}),
        Row('without L_Dice', LEAF, MERGED | {'dice_loss': None}),
        Row('without L_cls', LEAF, MERGED | {'scene_class_loss': None}),
        Row('without L_WSL (no pseudo labels)', LEAF, MERGED | {'label_refreshes': 1}),
        Row('without L_Aug', LEAF, MERGED | {'aug_loss': None}),
        Row('L_Aug by squared differences', LEAF, MERGED | {'aug_loss': {'loss': {'type': 'MSEAugLoss'}}}),
        Row('without the confidence gamma', LEAF, MERGED | {'objects': {'gamma': 0.01}}),
        Row('without A_des', LEAF, MERGED | {'oversegmenter': {'affinity_descriptor_weight': 0.0}}),
        Row('without A_n', LEAF, MERGED | {'oversegmenter': {'affinity_normal_weight': 0.0}}),
        Row('without M_des', LEAF, MERGED | {'merge': {'without': ['descriptor']}}),
        Row('without M_scale', LEAF, MERGED | {'merge': {'without': ['scale']}}),
        Row('without M_seg', LEAF, MERGED | {'merge': {'without': ['semantics']}}),
        Row('without weight balancing', LEAF, MERGED | {'merge': {'weight_balancing': False}}),
    ),
    scores=KITTI.scores,
)
