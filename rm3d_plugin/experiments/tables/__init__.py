"""Every table by its name; a file holds a family of them."""

from rm3d_plugin.experiments.spec import MeasuredTable, PaperTable, Table
from rm3d_plugin.experiments.tables import methods
from rm3d_plugin.experiments.tables.ablations import ABLATIONS
from rm3d_plugin.experiments.tables.budgets import BUDGET_TABLES
from rm3d_plugin.experiments.tables.clicks_to_quality import clicks_table
from rm3d_plugin.experiments.tables.descriptors_instance import TABLE_2, instance_table
from rm3d_plugin.experiments.tables.descriptors_matching import matching_table
from rm3d_plugin.experiments.tables.descriptors_overseg import descriptor_table
from rm3d_plugin.experiments.tables.detection import MECHANISMS
from rm3d_plugin.experiments.tables.figures import figures_table, method_rows
from rm3d_plugin.experiments.tables.method_pseudo_labels import method_pseudo_label_table, observed_rows
from rm3d_plugin.experiments.tables.oakland import OAKLAND
from rm3d_plugin.experiments.tables.octree import octree_table
from rm3d_plugin.experiments.tables.propagation import propagation_table
from rm3d_plugin.experiments.tables.pseudo_boxes import TRAINED, pseudo_box_table
from rm3d_plugin.experiments.tables.pseudo_label_rounds import SYNTHETIC, pseudo_label_table, synthetic_rows
from rm3d_plugin.experiments.tables.robustness_card import robustness_table
from rm3d_plugin.experiments.tables.rooms import ROOMS, ROOMS_BUDGETS, ROOMS_INSTANCES
from rm3d_plugin.experiments.tables.rotation import ROTATION
from rm3d_plugin.experiments.tables.streets import KITTI, STREETS, STREETS_BUDGETS
from rm3d_plugin.experiments.tables.transfer import TRANSFER
from rm3d_plugin.experiments.tables.unsupervised_instances import unsupervised_table

TABLES: dict[str, Table | PaperTable | MeasuredTable] = {
    'kitti-demo': KITTI,
    'detection-mechanisms': MECHANISMS,
    'pseudo-boxes': MeasuredTable('Pseudo boxes by rule, from one network (trains it)', pseudo_box_table, (TRAINED,)),
    'rooms-demo': ROOMS,
    'rooms-demo-budgets': ROOMS_BUDGETS,
    'rooms-demo-instances': ROOMS_INSTANCES,
    'streets-demo': STREETS,
    'streets-demo-budgets': STREETS_BUDGETS,
    'oakland': OAKLAND,
    'methods-indoor': methods.INDOOR,
    'methods-indoor-onept': methods.INDOOR_ONE_POINT,
    'methods-outdoor': methods.OUTDOOR,
    'methods-oakland': methods.OAKLAND,
    'methods-instances': methods.INSTANCES,
    'methods-detection': methods.DETECTION,
    'methods-scenes': methods.SCENES,
    'methods-pseudo-labels': MeasuredTable(
        'Answers of which networks are sure, and their offsets, by round and method (trains)',
        method_pseudo_label_table,
        observed_rows(),
    ),
    'propagation': MeasuredTable('mIoU on the unlabelled points of single real scans (trains)', propagation_table),
    'pseudo-labels': MeasuredTable(
        'Coverage and precision of pseudo labels by round, synthetic and real, both strategies (trains)',
        pseudo_label_table,
        tuple(row for kind in SYNTHETIC for rows in synthetic_rows(kind).values() for row in rows.values()),
    ),
    'clicks-to-quality': MeasuredTable(
        'Points that are right after each click of an annotator, by where the next click falls', clicks_table
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
    'unsupervised-instances': MeasuredTable(
        'Instances without a single label: regions merged by geometry and colour', unsupervised_table
    ),
    'octree': MeasuredTable("Radius search: ours, other programs, and each of the octree's rules", octree_table),
    'figures': MeasuredTable(
        'Pictures of labels by round and of regions by descriptor; quality of labels',
        figures_table,
        tuple(method_rows().values()),
    ),
    **BUDGET_TABLES,
    **ABLATIONS,
    'transfer': TRANSFER,
    'rotation': ROTATION,
}
ALL = (
    'budgets-indoor',
    'detection',
    'features-indoor',
    'losses-segmentation',
    'features-outdoor',
    'detection-losses-indoor',
    'detection-losses-outdoor',
    'losses-detection',
    'additions-indoor',
    'additions-outdoor',
    'transfer',
    'scenes',
    'methods-scenes',
    'rotation',
    'budgets-outdoor',
    'detection-mechanisms',
    'descriptors-instance-0.2',
    'pseudo-labels',
    'pseudo-boxes',
    'clicks-to-quality',
    'figures',
    'descriptors-overseg',
    'descriptors-matching',
    'robustness-card',
    'unsupervised-instances',
    'octree',
)
"""What ``reproduce all`` makes, in order of worth; where time is short, all are made smaller."""
