"""Every table by its name; a file holds a family of them."""

from rm3d_plugin.experiments.spec import MeasuredTable, Table
from rm3d_plugin.experiments.tables.descriptors_overseg import descriptor_table
from rm3d_plugin.experiments.tables.detection import ABLATIONS, MECHANISMS
from rm3d_plugin.experiments.tables.oakland import OAKLAND
from rm3d_plugin.experiments.tables.propagation import propagation_table
from rm3d_plugin.experiments.tables.pseudo_boxes import pseudo_box_table
from rm3d_plugin.experiments.tables.pseudo_label_rounds import pseudo_label_table
from rm3d_plugin.experiments.tables.robustness_card import robustness_table
from rm3d_plugin.experiments.tables.rooms import ROOMS, ROOMS_BUDGETS, ROOMS_INSTANCES
from rm3d_plugin.experiments.tables.streets import KITTI, STREETS, STREETS_BUDGETS

TABLES: dict[str, Table | MeasuredTable] = {
    'kitti-demo': KITTI,
    'detection-mechanisms': MECHANISMS,
    'detection-ablations': ABLATIONS,
    'pseudo-boxes': MeasuredTable('Pseudo boxes by rule, from one network (trains it)', pseudo_box_table),
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
    'robustness-card': MeasuredTable(
        'Similarity of the same point after turning, dropping points and noise', robustness_table
    ),
}
