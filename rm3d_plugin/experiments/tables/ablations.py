"""The paper's ablation tables, rows as METHOD 9 reads them, and our own additions one by one."""

from collections.abc import Mapping
from typing import Any

from rm3d_plugin.baselines import LABELLED_ONLY, Task
from rm3d_plugin.experiments.spec import PaperTable, Part, Row
from rm3d_plugin.experiments.tables.paper_rows import (
    AS_PAPER,
    DEFAULT,
    LEAF_BUDGETS,
    PAPER,
    leaf_row,
    once,
    trivial_rows,
)

Removed = Mapping[str, tuple[str, Mapping[str, Any]]]  # number of the paper's row -> name, options

NO_A_DES = {'merge.lambda_descriptor': 0}
NO_M_DES = {'merge.without': ['descriptor']}
SCORES = {
    'sem': ('mIoU',),
    'ins': ('AP50',),
    'kitti': ('Pedestrian_3d_hard_R40@0.25',),
    'waymo': ('Vehicle_L2_APH',),
    'votenet scannet': ('mAP50',),
}
TITLES = {
    'sem scannet': 'Classes of rooms as ScanNet has them, mIoU',
    'sem s3dis': 'Classes of rooms as S3DIS has them, mIoU',
    'ins scannet': 'Instances of rooms as ScanNet has them, AP50',
    'ins s3dis': 'Instances of rooms as S3DIS has them, AP50',
    'votenet scannet': 'Boxes of rooms as ScanNet has them, AP50',
    'votenet kitti': 'Boxes of streets as KITTI has them, pedestrians, 3D AP hard (R40, IoU .25)',
    'votenet waymo': 'Boxes of streets as Waymo has them, vehicles, level 2 APH',
}
INDOOR: tuple[tuple[Task, str], ...] = (('sem', 'scannet'), ('ins', 'scannet'), ('sem', 's3dis'), ('ins', 's3dis'))
OUTDOOR: tuple[tuple[Task, str], ...] = (('votenet', 'kitti'), ('votenet', 'waymo'))
TWINS = (
    'Rows whose ticks are equal (indoor 3 and 8, outdoor 3 and 7): the first removes M_des, the second M_des and A_des.'
)


def features(over: str) -> dict[str, tuple[str, Mapping[str, Any]]]:
    """What rows remove, by name; the same indoors and outdoors.

    Args:
        over: Key of the over-segmenter in the config.
    """
    no_a_des = {f'{over}.affinity_descriptor_weight': 0.0}
    return {
        'A_des': ('without A_des in the affinity of regions', NO_A_DES),
        'A_n': ('without A_n in the over-segmentation', {f'{over}.affinity_normal_weight': 0.0}),
        'M_des': ('without M_des', NO_M_DES),
        'M_color': ('without M_color', {'merge.without': ['color']}),
        'M_scale': ('without M_scale', {'merge.without': ['scale']}),
        'M_seg': ('without M_seg', {'merge.without': ['semantics']}),
        'all': (PAPER, {}),
        'both': ('without M_des and A_des', NO_M_DES | no_a_des),
        'WB': ('without weight balancing', {'merge.weight_balancing': False}),
    }


def losses(task: Task) -> dict[str, tuple[str, Mapping[str, Any]]]:
    """Rows of the tables of losses and of the threshold gamma, in their order."""
    no_labels = LABELLED_ONLY.options[task]
    alone = {key: value for key, value in no_labels.items() if key in ('label_refreshes', 'propagate')}
    return {
        'all': (PAPER, {}),
        'L_WSL': ('no pseudo labels', alone),
        'L_Aug': ('without L_Aug', {'aug_loss': None}),
        'gamma': ('without the threshold gamma', {'merge.gamma': 0.01}),
        'MSE': ('squared differences in L_Aug', {'aug_loss.loss.type': 'MSEAugLoss'}),
    }


DETECTION_LOSSES: dict[str, tuple[str, Mapping[str, Any]]] = {
    '1': (PAPER, {}),
    '2': ('without L_Seg', {'point_loss': None, 'aug_loss': None}),
    '3': ('without L_Dice', {'dice_loss': None}),
    '4': ('without L_cls', {'scene_class_loss': None}),
}


def numbered(named: Mapping[str, tuple[str, Mapping[str, Any]]], order: str, first: int = 1) -> Removed:
    """Rows under the paper's numbers.

    >>> list(numbered({'a': ('A', {}), 'b': ('B', {})}, 'b a'))
    ['1', '2']
    """
    return {str(number): named[name] for number, name in enumerate(order.split(), first)}


def paper_part(task: Task, data: str, removed: Removed, paper: str) -> Part:
    """The paper's rows with ``strategy='paper'``, then what is trivial and RM3D as it is by default.

    Args:
        task: sem, ins or votenet.
        data: Data set, as configs name it.
        removed: Number of the paper's row -> its name and options.
        paper: Table and column.
    """
    budget = LEAF_BUDGETS[task]
    leaf = f'rm3d_{task}_{data}_{budget}'
    rows = [leaf_row(name, leaf, {**options, **AS_PAPER}, number) for number, (name, options) in removed.items()]
    return _part(task, data, (*rows, *trivial_rows(task, data, budget)), PAPER, paper)


def addition_part(task: Task, data: str, additions: Mapping[str, Mapping[str, Any]]) -> Part:
    """RM3D as it is by default, and each of our additions taken away; then the paper's method and what is trivial.

    Args:
        task: sem, ins or votenet.
        data: Data set, as configs name it.
        additions: Name of the row -> options.
    """
    budget = LEAF_BUDGETS[task]
    leaf = f'rm3d_{task}_{data}_{budget}'
    rows: list[Row] = [leaf_row(DEFAULT, leaf), *(leaf_row(name, leaf, changed) for name, changed in additions.items())]
    alone, _ = trivial_rows(task, data, budget)
    return _part(task, data, (*rows, leaf_row(PAPER, leaf, AS_PAPER), alone), DEFAULT, '')


def _part(task: Task, data: str, rows: tuple[Row, ...], base: str, paper: str) -> Part:
    place = f'{task} {data}'
    score = SCORES.get(place) or SCORES[data if task == 'votenet' else task]
    return Part(TITLES[place], once(rows), score, base, paper)


def _features_indoor() -> tuple[Part, ...]:
    removed = numbered(features('oversegmenter'), 'A_des A_n M_des M_color M_scale M_seg all both WB')
    return tuple(paper_part(task, data, removed, f'table_ablation_fea_i:{task}_{data}') for task, data in INDOOR)


def _losses_segmentation() -> tuple[Part, ...]:
    order = 'all L_WSL L_Aug gamma MSE'
    return tuple(
        paper_part(
            task,
            data,
            numbered(losses(task), order, 1 if task == 'sem' else 6),
            f'table_ablation_loss_i:{task}_{data}',
        )
        for task, data in INDOOR
    )


def _outdoor(label: str, removed: Removed) -> tuple[Part, ...]:
    return tuple(paper_part(task, data, removed, f'{label}:{data}') for task, data in OUTDOOR)


WALKER_ADDITIONS: dict[str, Mapping[str, Any]] = {
    'every point has a label (accept 0)': {'walker.accept': 0},
    'the network has no say in labels': {'walker.judging': 0},
    'labels of round 0 stay': {'label_refreshes': 1},
    'no shift of the class prior': {'random_walk.prior_rounds': 0},
    'what classes look like has no strength': {
        'random_walk.features_strength': 0.0,
        'random_walk.taught_strength': 0.0,
    },
    'merged regions in place of the walk': {'strategy': 'regions'},
}
DETECTION_ADDITIONS: dict[str, Mapping[str, Any]] = {
    'predicted boxes have no say': {'objects.support_iou': None},
    'every candidate is a pseudo box': {'objects.top_fraction': None},
    'one gamma for all classes': {'objects.class_gamma': None},
    'boxes along the axes': {'objects.box': 'axis_aligned'},
    'mixed regions stay whole': {'objects.part_share': 2.0},
    'objects of any height': {'objects.seen_height': None},
    'no objects pasted': {'paste_objects': 0},
    'labels of round 0 stay': {'label_refreshes': 1},
}

ABLATIONS: dict[str, PaperTable] = {
    'features-indoor': PaperTable('Features, indoors, 0.2 % of the points, in percent', _features_indoor(), (TWINS,)),
    'features-outdoor': PaperTable(
        'Features, outdoors, 1 % of the boxes, in percent',
        _outdoor(
            'table_ablation_fea_o',
            numbered(features('oversegmenter'), 'A_des A_n M_des M_scale M_seg all both WB'),
        ),
        (TWINS,),
    ),
    'losses-segmentation': PaperTable(
        'Losses and the threshold gamma, 0.2 % of the points, in percent',
        _losses_segmentation(),
        ('No threshold: gamma = .01, under the largest of 20 probabilities.',),
    ),
    'losses-detection': PaperTable(
        'Losses and the threshold gamma, 1 % of the boxes, in percent',
        _outdoor('table_ablation_loss_det_o', numbered(losses('votenet'), 'all L_WSL L_Aug gamma MSE')),
    ),
    'detection-losses-indoor': PaperTable(
        'Losses of the detector, indoors, 1 % of the boxes, in percent',
        (paper_part('votenet', 'scannet', DETECTION_LOSSES, 'table_ablation_detect_i:scannet'),),
        ('L_Seg: the losses of the branch of points, L_WSL and L_Aug.',),
    ),
    'detection-losses-outdoor': PaperTable(
        'Losses of the detector, outdoors, 1 % of the boxes, in percent',
        _outdoor('table_ablation_detect_o', DETECTION_LOSSES),
        ('L_Seg: the losses of the branch of points, L_WSL and L_Aug.',),
    ),
    'additions-indoor': PaperTable(
        'Our additions to the paper, one by one, rooms, 0.2 % of the points, in percent',
        tuple(addition_part(task, data, WALKER_ADDITIONS) for task, data in INDOOR[:2]),
    ),
    'additions-outdoor': PaperTable(
        'Our additions to the paper, one by one, boxes of streets, in percent',
        (addition_part('votenet', 'kitti', DETECTION_ADDITIONS),),
    ),
}
