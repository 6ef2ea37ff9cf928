"""The paper's main tables: every method with every label budget."""

from typing import Any

from rm3d_plugin.baselines import FULL_SUPERVISION, LABELLED_ONLY, Task
from rm3d_plugin.experiments.spec import PaperTable, Part
from rm3d_plugin.experiments.tables.paper_rows import AS_PAPER, DEFAULT, PAPER, leaf_row, method_rows_of

INDOOR: tuple[tuple[Task, str, tuple[str, ...], str], ...] = (
    ('sem', 'scannet', ('mIoU',), 'Classes of rooms as ScanNet has them, mIoU'),
    ('ins', 'scannet', ('AP50',), 'Instances of rooms as ScanNet has them, AP50'),
    ('sem', 's3dis', ('mIoU',), 'Classes of rooms as S3DIS has them, mIoU'),
    ('ins', 's3dis', ('AP50',), 'Instances of rooms as S3DIS has them, AP50'),
)
OUTDOOR: tuple[tuple[Task, str, tuple[str, ...], str], ...] = (
    ('sem', 'semantickitti', ('mIoU',), 'Classes of streets as SemanticKITTI has them, mIoU'),
    ('sem', 'semantic3d', ('mIoU',), 'Classes of streets as Semantic3D has them, mIoU'),
)
POINTS = {'0p2pct': '0.2 % of the points', 'onept': 'a point a class', '1pct': '1 % of the points'}
BOXES = {'1pct': '1 % of the boxes', '0p5pct': '0.5 % of the boxes', '3pct': '3 % of the boxes'}
DETECTION = {
    'kitti_moderate': (
        'kitti',
        'Pedestrian_3d_moderate_R40@0.25',
        'pedestrians of streets as KITTI has them, moderate',
    ),
    'kitti_easy': ('kitti', 'Pedestrian_3d_easy_R40@0.25', 'pedestrians of streets as KITTI has them, easy'),
    'kitti_hard': ('kitti', 'Pedestrian_3d_hard_R40@0.25', 'pedestrians of streets as KITTI has them, hard'),
    'waymo_vehicle': ('waymo', 'Vehicle_L2_APH', 'vehicles of streets as Waymo has them, level 2 APH'),
    'waymo_pedestrian': ('waymo', 'Pedestrian_L2_APH', 'pedestrians of streets as Waymo has them, level 2 APH'),
    'waymo_cyclist': ('waymo', 'Cyclist_L2_APH', 'cyclists of streets as Waymo has them, level 2 APH'),
}
SCENES = {'1pct': 1, '5pct': 5, '10pct': 10, '20pct': 20}  # percent of the scenes, as the paper names them


def _points(kinds: tuple[tuple[Task, str, tuple[str, ...], str], ...], label: str) -> tuple[Part, ...]:
    return tuple(
        Part(
            f'{title}, {shown}',
            method_rows_of(task, data, budget),
            score,
            PAPER,
            f'{label}:{task}_{data}',
        )
        for budget, shown in POINTS.items()
        for task, data, score, title in kinds
    )


def _detection() -> tuple[Part, ...]:
    return tuple(
        Part(
            f'{title}, {shown}', method_rows_of('votenet', data, budget), (key,), PAPER, f'tablewslresults_det:{column}'
        )
        for budget, shown in BOXES.items()
        for column, (data, key, title) in DETECTION.items()
    )


def _scenes() -> tuple[Part, ...]:
    parts = []
    for column, percent in SCENES.items():
        budget: dict[str, Any] = {'budget': f'scenes{percent}pct'}
        rows = (
            leaf_row(PAPER, 'rm3d_ins_scannet_0p2pct', {**budget, **AS_PAPER}, 'rm3d'),
            leaf_row(DEFAULT, 'rm3d_ins_scannet_0p2pct', budget, 'rm3d'),
            leaf_row(LABELLED_ONLY.row('ins'), FULL_SUPERVISION.config('ins', 'scannet', ''), budget, 'labelled_only'),
            leaf_row(FULL_SUPERVISION.row('ins'), FULL_SUPERVISION.config('ins', 'scannet', '')),
        )
        parts.append(Part(f'{percent} % of the rooms, AP', rows, ('AP',), PAPER, f'tab_twist:{column}'))
    return tuple(parts)


BUDGET_TABLES: dict[str, PaperTable] = {
    'budgets-indoor': PaperTable('Every method, indoors, in percent', _points(INDOOR, 'tablewslresults_sem_indoor')),
    'budgets-outdoor': PaperTable(
        'Every method, outdoors, in percent', _points(OUTDOOR, 'tablewslresults_sem_outdoor')
    ),
    'detection': PaperTable(
        'Boxes, every method, in percent (KITTI: 3D AP, R40, IoU .25)',
        _detection(),
    ),
    'scenes': PaperTable(
        'Instances from a few labelled rooms, in percent',
        _scenes(),
        ('The paper adds contrastive losses (CSC) to its method here; ours has none.',),
    ),
}
