"""The data sample that travels with a scene through model and metric."""

from mmengine.structures import BaseDataElement


class SceneSample(BaseDataElement):
    """Labels and predictions of one scene; field names follow mmdetection3d 1.x.

    Metainfo: ``scene_id`` (str), ``num_points`` (int, points of the whole scene before any were dropped).

    Input fields (absent where unknown):
        point_index: (n,) int64, the scene's number of each input point.
        gt_bboxes_3d: (M, 7) float32 as :class:`Boxes3D`, gt_labels_3d: (M,) int64, gt_is_annotated: (M,) bool.
        pts_semantic_mask: (n,) int64, -1 = unlabelled; pts_instance_mask: (n,) int64, row of gt_bboxes_3d or -1.
        pts_is_annotated: (n,) bool, True where the class was annotated by the budget.
        pts_confidence: (n,) float32 in [0, 1], how likely the class is right; 1 for annotated points.
        pts_region: (n,) int64, region of each point, -1 = none.
        pts_height: (n,) float32 metres above the ground.

    Output fields:
        pred_bboxes_3d: (K, 7) float32, pred_labels_3d: (K,) int64, pred_scores_3d: (K,) float32.
        pred_point_probs: (n, C + 1) float32 softmax, background last in detection.
        pred_point_centers: (n, 3) float32 metres, where each point votes its object's centre to be.
    """
