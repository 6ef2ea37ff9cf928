"""Label sources and label makers: one scene's geometry, annotated labels and prediction in, its labels out."""

from rm3d_plugin.labeling.accept import Accept, Accepted, ConfidentPoints, ConfidentRegions
from rm3d_plugin.labeling.annotated import AnnotatedLabelMaker
from rm3d_plugin.labeling.detection import DetectionLabelMaker
from rm3d_plugin.labeling.label_maker import LabelMaker
from rm3d_plugin.labeling.point_labels import point_label_maker
from rm3d_plugin.labeling.point_source import PointBudgetSource
from rm3d_plugin.labeling.predicted import PredictedLabelMaker
from rm3d_plugin.labeling.prepared_scenes import PreparedScenes
from rm3d_plugin.labeling.segmentation import SegmentationLabelMaker
from rm3d_plugin.labeling.sources import BoxBudgetSource, DatasetSource, LabelSource
from rm3d_plugin.labeling.walker import WalkerLabelMaker

__all__ = [
    'Accept',
    'Accepted',
    'AnnotatedLabelMaker',
    'BoxBudgetSource',
    'ConfidentPoints',
    'ConfidentRegions',
    'DatasetSource',
    'DetectionLabelMaker',
    'LabelMaker',
    'LabelSource',
    'PointBudgetSource',
    'PredictedLabelMaker',
    'PreparedScenes',
    'SegmentationLabelMaker',
    'WalkerLabelMaker',
    'point_label_maker',
]
