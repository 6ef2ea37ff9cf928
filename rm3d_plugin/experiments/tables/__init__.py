"""Every table by its name; a file holds a family of them."""

from rm3d_plugin.experiments.spec import MeasuredTable, Table
from rm3d_plugin.experiments.tables.descriptors_instance import TABLE_2, instance_table
from rm3d_plugin.experiments.tables.descriptors_matching import matching_table
from rm3d_plugin.experiments.tables.descriptors_overseg import descriptor_table
from rm3d_plugin.experiments.tables.oakland import OAKLAND
from rm3d_plugin.experiments.tables.propagation import propagation_table
from rm3d_plugin.experiments.tables.pseudo_label_rounds import pseudo_label_table
from rm3d_plugin.experiments.tables.robustness_card import robustness_table
from rm3d_plugin.experiments.tables.rooms import ROOMS, ROOMS_BUDGETS, ROOMS_INSTANCES
from rm3d_plugin.experiments.tables.streets import KITTI, STREETS, STREETS_BUDGETS

TABLES: dict[str, Table | MeasuredTable] = {
    'kitti-demo': KITTI,
    'rooms-demo': ROOMS,
    'rooms-demo-budgets': ROOMS_BUDGETS,
    'rooms-demo-instances': ROOMS_INSTANCES,
    'streets-demo': STREETS,
    'streets-demo-budgets': STREETS_BUDGETS,
    'oakland': OAKLAND,
    'propagation': MeasuredTable('mIoU on the unlabelled points of single real scans (trains)', propagation_table),
    'pseudo-labels': MeasuredTable(
        'Coverage and precision of pseudo labels by round, synthetic and real, both strategies (trains)',
        pseudo_label_table,
    ),
    'descriptors-overseg': MeasuredTable(
        'Boundary scores of regions by descriptor, as scanned and turned', descriptor_table
    ),
    'descriptors-instance': TABLE_2,
    'descriptors-instance-0.2': instance_table(['0p2pct']),
    'descriptors-matching': MeasuredTable(
        'The same place found in two scans, and objects told apart, by descriptor, as scanned and turned',
        matching_table,
    ),
    'robustness-card': MeasuredTable(
        'Similarity of the same point after turning, dropping points and noise', robustness_table
    ),
}
