"""Label sources and label makers: one scene's geometry, known labels and prediction in, its labels out."""

from rm3d_plugin.labeling.detection import DetectionLabelMaker
from rm3d_plugin.labeling.label_maker import LabelMaker, PointPrediction
from rm3d_plugin.labeling.point_source import PointBudgetSource
from rm3d_plugin.labeling.segmentation import SegmentationLabelMaker
from rm3d_plugin.labeling.sources import BoxBudgetSource, DatasetSource, LabelSource

__all__ = [
    'LabelMaker',
    'BoxBudgetSource',
    'DatasetSource',
    'LabelSource',
    'PointBudgetSource',
    'SegmentationLabelMaker',
    'PointPrediction',
    'DetectionLabelMaker',
]
