"""The detector: sparse U-Net, point branch, votes, and the losses of METHOD 7."""

from collections.abc import Sequence
from typing import Any, NamedTuple, final

import torch
from mmengine.structures import BaseDataElement
from torch import Tensor, nn

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.detectors.point_features import CHANNELS, point_features
from rm3d_plugin.models.detectors.tta_views import AS_SCANNED, TtaView, as_scanned, pool_views, seen
from rm3d_plugin.models.heads.batch_labels import BatchLabels, join_labels
from rm3d_plugin.models.heads.box_coder import decode_boxes
from rm3d_plugin.models.heads.decode import Detections, class_scores, scored_by_height, select_boxes, stand_on_ground
from rm3d_plugin.models.outputs import DetectorOutput
from rm3d_plugin.models.point_model import LossConfigs, PointModel
from rm3d_plugin.ops.grouping import gather_groups
from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import LabelStatistics


def detection_losses(num_classes: int) -> LossConfigs:
    """L_Det of METHOD 7: VoteNet's + L_WSL + L_Aug + L_Dice + L_cls."""
    return [
        {'type': 'VoteNetLoss'},
        {'type': 'WeakSupervision', 'balance': 'batch'},
        {'type': 'ViewConsistency'},
        {'type': 'ProposalDice'},
        {'type': 'SceneClasses', 'num_classes': num_classes},
    ]


def _views(given: Sequence[Sequence[bool | float]] | None) -> tuple[TtaView, ...]:
    if given is None:
        return (AS_SCANNED,)
    views = tuple(TtaView(bool(mirrored), float(turn)) for mirrored, turn in given)
    if not views or views[0] != AS_SCANNED:
        raise ValueError(f'RM3DVoteNet.tta_views: expected [False, 0.0] first, the scene as scanned, got {given}')
    return views


class _Seen(NamedTuple):
    """What one view says: boxes of each scene as scanned, probabilities of the points, where they vote to (in it)."""

    boxes: list[Detections]
    probs: Tensor
    centers: Tensor


@MODELS.register_module()
@final
class RM3DVoteNet(PointModel):
    """VoteNet on a sparse U-Net, trained from (pseudo) boxes and point labels.

    ::

        points -> backbone -> features -> linear -> P_out (C + 1) -> L_WSL, L_Aug, L_cls
                                  +------> vote head -> boxes -> VoteNet's loss, L_Dice
                                  +------> IoU head (if any): how well each box fits -> BoxOverlap

    Only backbone, point branch, vote head and IoU head run at test time.

    Args:
        backbone: Config of a backbone with ``forward(xyz, features, batch_offsets)`` and ``out_channels``;
            ``in_channels`` is filled in.
        num_classes: Box classes C.
        vote_head: Config of the vote head; ``in_channels`` and ``num_classes`` are filled in.
        iou_head: Config of a :class:`~rm3d_plugin.models.heads.BoxIoUHead`, whose overlap the scores are multiplied by;
            ``in_channels`` is filled in. It learns by the loss ``BoxOverlap``. None: scores do not ask how a box fits.
        losses: Configs of :class:`LossTerm`; None among them is left out. By default :func:`detection_losses`.
        heights: Lowest and highest usual z in metres.
        score_threshold: A box with a lower score is not predicted.
        nms_iou: Overlap from above that makes two boxes of a class duplicates.
        fuse_iou: Overlap from above at which duplicates are averaged into the box that stays; None: they are dropped.
        max_boxes: Most boxes a scene.
        score_by_points: Scores also ask P_out of the grouped points.
        on_ground: Predicted boxes stand on the ground, where the pipeline tells how high above it points are
            (``DropGround`` does): few boxes teach badly how high an object lies.
        score_by_height: With ``on_ground``: scores are multiplied by the share of a box's height that its points reach.
        tta_views: How scenes are seen at test time, (mirrored, turn in radians) each: what is found in all of them is
            pooled, see :func:`~rm3d_plugin.models.detectors.tta_views.pool_views`. The first must be as scanned.
            Prediction takes as many times as long. None: as scanned alone.
        data_preprocessor: ``ScenePreprocessor`` by default.
        init_cfg: As in mmengine.
    """

    def __init__(
        self,
        backbone: dict[str, Any],
        num_classes: int,
        vote_head: dict[str, Any] | None = None,
        iou_head: dict[str, Any] | None = None,
        losses: LossConfigs | None = None,
        heights: tuple[float, float] | list[float] = (-2.0, 2.0),
        score_threshold: float = 0.05,
        nms_iou: float = 0.25,
        fuse_iou: float | None = None,
        max_boxes: int = 100,
        score_by_points: bool = False,
        on_ground: bool = False,
        score_by_height: bool = False,
        tta_views: Sequence[Sequence[bool | float]] | None = None,
        data_preprocessor: dict[str, Any] | None = None,
        init_cfg: dict[str, Any] | None = None,
    ) -> None:
        super().__init__(backbone, CHANNELS, data_preprocessor, init_cfg)
        self.num_classes = num_classes
        self.heights = (float(heights[0]), float(heights[1]))
        self.score_threshold, self.nms_iou, self.fuse_iou = score_threshold, nms_iou, fuse_iou
        self.max_boxes, self.score_by_points, self.on_ground = max_boxes, score_by_points, on_ground
        if score_by_height and not on_ground:
            raise ValueError(
                'RM3DVoteNet.score_by_height: asks boxes that stand on the ground; set on_ground=True, too'
            )
        self.score_by_height = score_by_height
        self.tta_views = _views(tta_views)
        channels = self.backbone.out_channels
        self.point_branch = nn.Linear(channels, num_classes + 1)
        head = {'type': 'VoteHead', **(vote_head or {}), 'in_channels': channels, 'num_classes': num_classes}
        self.vote_head = MODELS.build(head)
        self.iou_head = (
            None if iou_head is None else MODELS.build({'type': 'BoxIoUHead', **iou_head, 'in_channels': channels})
        )
        given = {*DetectorOutput._fields, *BatchLabels._fields} - ({'fit_pairs'} if iou_head is None else set())
        self.add_losses(detection_losses(num_classes) if losses is None else losses, given)

    def set_label_statistics(self, statistics: LabelStatistics) -> None:
        """The sizes of the annotated boxes become the size templates, where known; what is unknown may be open."""
        for part in self.modules():
            if hasattr(part, 'unlabelled_weight'):
                part.judged = statistics.judged
        if statistics.mean_sizes is not None:
            self.vote_head.set_mean_sizes(torch.tensor(statistics.mean_sizes, dtype=torch.float32))

    def encode(self, points: Tensor, batch_offsets: Tensor) -> Tensor:
        """Features (N, F) of the points of a batch."""
        features: Tensor = self.backbone(points[:, :3], point_features(points, self.heights), batch_offsets)
        return features

    def classify(self, features: Tensor) -> Tensor:
        """P_out (N, C + 1) as logits, background last."""
        logits: Tensor = self.point_branch(features)
        return logits.float()

    def network(self, batch: Batch) -> DetectorOutput:
        """Run backbone, point branch and vote head on a batch."""
        features = self.encode(batch.points, batch.batch_offsets)
        logits = self.classify(features)
        foreground = 1.0 - logits.detach().softmax(dim=1)[:, -1]
        votes = self.vote_head(batch.xyz, features, foreground, batch.batch_offsets)
        if self.iou_head is None:
            return DetectorOutput(features, logits, votes)
        boxes = decode_boxes(votes.prediction, votes.mean_sizes)
        return DetectorOutput(features, logits, votes, self.iou_head(boxes, votes.anchor_offsets, votes.seeds))

    def labels(self, samples: Sequence[BaseDataElement], batch: Batch, outputs: DetectorOutput) -> BatchLabels:
        """Boxes and point labels, and which box each proposal should say."""
        labels = join_labels(samples, batch.batch_offsets, batch.xyz, self.num_classes)
        labels = labels._replace(targets=self.vote_head.targets(outputs.votes, labels))
        if self.iou_head is None:
            return labels
        votes = outputs.votes
        boxes = decode_boxes(votes.prediction, votes.mean_sizes)
        return labels._replace(fit_pairs=self.iou_head.pairs(boxes, outputs.fits, labels, votes.seeds))

    def predict(self, batch: Batch, samples: list[BaseDataElement]) -> None:
        """Boxes; with ``predict_points`` also class probabilities of all points, and their votes as scanned."""
        views = [self._see(batch, view) for view in self.tta_views]
        places = batch.xyz.split(batch.sizes)
        for i, sample in enumerate(samples):
            found = views[0].boxes[i]
            if len(views) > 1:
                found = pool_views([view.boxes[i] for view in views], self.nms_iou, self.fuse_iou, self.max_boxes)
            if self.on_ground and 'pts_height' in sample:
                found = stand_on_ground(found, places[i], sample.pts_height)
                if self.score_by_height:
                    found = scored_by_height(found, places[i], sample.pts_height)
            sample.pred_bboxes_3d, sample.pred_labels_3d, sample.pred_scores_3d = found
        if self.predict_points:
            probs = torch.stack([view.probs for view in views]).mean(dim=0).split(batch.sizes)
            for sample, own, centers in zip(samples, probs, views[0].centers.split(batch.sizes), strict=True):
                sample.pred_point_probs, sample.pred_point_centers = own.cpu(), centers.cpu()

    def _see(self, batch: Batch, view: TtaView) -> _Seen:
        """Boxes of each scene, as scanned, from one view."""
        batch = seen(batch, view)
        output = self.network(batch)
        probs, ends = output.logits.softmax(dim=1), output.votes.anchor_offsets.tolist()
        found = [self._boxes(output, probs, slice(a, b)) for a, b in zip(ends[:-1], ends[1:], strict=True)]
        return _Seen([as_scanned(part, view) for part in found], probs, batch.xyz + output.votes.offsets)

    def _boxes(self, output: DetectorOutput, probs: Tensor, rows: slice) -> Detections:
        votes = output.votes
        prediction = type(votes.prediction)(*(column[rows] for column in votes.prediction))
        members, group_probs = votes.members[rows], None
        if self.score_by_points:
            there = (members >= 0).sum(dim=1, keepdim=True).clamp_min(1)
            group_probs = gather_groups(probs[:, :-1], members).sum(dim=1) / there
        fits = None if output.fits is None else output.fits[rows].sigmoid()
        scores = class_scores(prediction, group_probs, fits)
        limits = (self.score_threshold, self.nms_iou, self.max_boxes, self.fuse_iou)
        return select_boxes(decode_boxes(prediction, votes.mean_sizes), scores, *limits)
