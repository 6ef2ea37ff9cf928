"""The detector: sparse U-Net, point branch, votes, and the losses of METHOD 7."""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import torch
from jaxtyping import Float
from mmengine.model import BaseModel
from torch import Tensor, nn

from rm3d_plugin.models.common_points import common_rows
from rm3d_plugin.models.detectors.point_features import point_features
from rm3d_plugin.models.heads.batch_labels import BatchLabels, join_labels
from rm3d_plugin.models.heads.decode import decode_scene
from rm3d_plugin.models.heads.instance_masks import instance_masks
from rm3d_plugin.models.heads.vote_head import VoteOutput
from rm3d_plugin.models.heads.vote_targets import ProposalTargets
from rm3d_plugin.models.view_statistics import kept_statistics
from rm3d_plugin.ops.grouping import gather_groups
from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import LabelStatistics, SceneSample

_COMMON_POINTS = 1000  # METHOD 7


class NetworkOutput(NamedTuple):
    """What the network computed for a batch.

    Attributes:
        logits: (N, C + 1) P_out, background last.
        votes: Output of the vote head.
    """

    logits: Float[Tensor, 'points classes_and_one']
    votes: VoteOutput


def _build(config: dict[str, Any] | None) -> nn.Module | None:
    return None if config is None else MODELS.build(config)


@MODELS.register_module()
class RM3DVoteNet(BaseModel):
    """VoteNet on a sparse U-Net, trained from (pseudo) boxes and point labels.

    ::

        points -> backbone -> features -> linear -> P_out (C + 1) -> L_WSL, L_Aug, L_cls
                                  +------> vote head -> boxes -> VoteNet's loss, L_Dice

    L_Det = L_WSL + L_Aug + L_Dice + L_cls + VoteNet's. Every term but VoteNet's is a part that may be None, and holds
    its own weight. Only backbone, point branch and vote head run at test time.

    Args:
        backbone: Config of a backbone with ``forward(xyz, features, batch_offsets)`` and ``out_channels``; it gets 4
            input channels.
        num_classes: Box classes C.
        vote_head: Config of the vote head; ``in_channels`` and ``num_classes`` are filled in.
        point_loss: L_WSL on P_out, or None.
        aug_loss: ``JSAugLoss``, ``MSEAugLoss`` or None; needs an augmented view in the batch.
        dice_loss: ``DiceLoss`` or None.
        scene_class_head: L_cls; ``num_classes`` is filled in; or None.
        heights: Lowest and highest usual z in metres.
        predict_points: Also predict class probabilities and votes of all points (for pseudo labels).
        score_threshold: A box with a lower score is not predicted.
        nms_iou: Overlap from above that makes two boxes of a class duplicates.
        fuse_iou: Overlap from above at which duplicates are averaged into the box that stays; None: they are dropped.
        max_boxes: Most boxes a scene.
        score_by_points: Scores also ask P_out of the grouped points.
        data_preprocessor: ``ScenePreprocessor`` by default.
        init_cfg: As in mmengine.
    """

    def __init__(
        self,
        backbone: dict[str, Any],
        num_classes: int,
        vote_head: dict[str, Any] | None = None,
        point_loss: dict[str, Any] | None = {'type': 'PointCrossEntropyLoss', 'balance': 0.5},  # noqa: B006
        aug_loss: dict[str, Any] | None = {'type': 'JSAugLoss'},  # noqa: B006
        dice_loss: dict[str, Any] | None = {'type': 'DiceLoss'},  # noqa: B006
        scene_class_head: dict[str, Any] | None = {'type': 'SceneClassHead'},  # noqa: B006
        heights: tuple[float, float] | list[float] = (-2.0, 2.0),
        predict_points: bool = False,
        score_threshold: float = 0.05,
        nms_iou: float = 0.25,
        fuse_iou: float | None = None,
        max_boxes: int = 100,
        score_by_points: bool = False,
        data_preprocessor: dict[str, Any] | None = None,
        init_cfg: dict[str, Any] | None = None,
    ) -> None:
        super().__init__(data_preprocessor or {'type': 'rm3d_plugin.ScenePreprocessor'}, init_cfg)
        self.num_classes = num_classes
        self.heights = (float(heights[0]), float(heights[1]))
        self.predict_points, self.score_by_points = predict_points, score_by_points
        self.score_threshold, self.nms_iou, self.max_boxes = score_threshold, nms_iou, max_boxes
        self.fuse_iou = fuse_iou
        self.backbone = MODELS.build(backbone)
        channels = self.backbone.out_channels
        self.point_branch = nn.Linear(channels, num_classes + 1)
        head = {'type': 'VoteHead', **(vote_head or {}), 'in_channels': channels, 'num_classes': num_classes}
        self.vote_head = MODELS.build(head)
        self.point_loss, self.aug_loss, self.dice_loss = _build(point_loss), _build(aug_loss), _build(dice_loss)
        self.scene_class_head = (
            None if scene_class_head is None else MODELS.build({**scene_class_head, 'num_classes': num_classes})
        )

    def set_mean_sizes(self, sizes: Float[Tensor, 'classes 3']) -> None:
        """Set the size templates of the vote head (metres)."""
        self.vote_head.set_mean_sizes(sizes)

    def set_label_statistics(self, statistics: LabelStatistics) -> None:
        """Set the size templates to those of the annotated boxes, where each class has any."""
        if statistics.mean_sizes is not None:
            self.set_mean_sizes(torch.tensor(statistics.mean_sizes, dtype=torch.float32))

    def forward(
        self,
        inputs: dict[str, Tensor],
        data_samples: Sequence[SceneSample] | None = None,
        mode: Literal['loss', 'predict', 'tensor'] = 'tensor',
    ) -> Any:
        """Losses by name, samples with predictions, or the plain :class:`NetworkOutput`."""
        if mode == 'loss':
            return self.loss(inputs, data_samples or [])
        if mode == 'predict':
            return self.predict(inputs, data_samples)
        if mode == 'tensor':
            return self.network(inputs)
        raise ValueError(f'mode: expected loss, predict or tensor, got {mode}')

    def _features(self, points: Tensor, batch_offsets: Tensor) -> Tensor:
        features: Tensor = self.backbone(points[:, :3], point_features(points, self.heights), batch_offsets)
        return features

    def network(self, inputs: dict[str, Tensor]) -> NetworkOutput:
        """Run backbone, point branch and vote head on a batch."""
        points, batch_offsets = inputs['points'], inputs['batch_offsets']
        features = self._features(points, batch_offsets)
        logits = self.point_branch(features).float()
        foreground = 1.0 - logits.detach().softmax(dim=1)[:, -1]
        return NetworkOutput(logits, self.vote_head(points[:, :3], features, foreground, batch_offsets))

    def loss(self, inputs: dict[str, Tensor], data_samples: Sequence[SceneSample]) -> dict[str, Tensor]:
        """Every term of L_Det by name, weighted."""
        labels = join_labels(data_samples, inputs['batch_offsets'])
        output = self.network(inputs)
        xyz = inputs['points'][:, :3]
        targets = self.vote_head.targets(output.votes, labels)
        losses: dict[str, Tensor] = self.vote_head.loss(output.votes, xyz, labels, targets)
        if self.point_loss is not None:
            losses['loss_wsl'] = self.point_loss(output.logits, labels.semantic)
        if self.aug_loss is not None and 'aug_points' in inputs:
            losses['loss_aug'] = self._view_loss(inputs, output.logits)
        if self.dice_loss is not None:
            losses['loss_dice'] = self._mask_loss(inputs, output, targets, labels)
        if self.scene_class_head is not None:
            losses.update(self.scene_class_head.loss(output.logits, labels))
        return losses

    def _view_loss(self, inputs: dict[str, Tensor], logits: Tensor) -> Tensor:
        """Agreement of P_out with the augmented view; only backbone and point branch see that view."""
        assert self.aug_loss is not None
        rows = common_rows(inputs['aug_index'], _COMMON_POINTS)
        with kept_statistics(self.backbone):
            features = self._features(inputs['aug_points'], inputs['aug_batch_offsets'])
        logits_aug = self.point_branch(features[rows]).float()
        loss: Tensor = self.aug_loss(logits[inputs['aug_index'][rows]], logits_aug)
        return loss

    def _mask_loss(
        self, inputs: dict[str, Tensor], output: NetworkOutput, targets: ProposalTargets, labels: BatchLabels
    ) -> Tensor:
        """L_Dice averaged over the objects that have a positive proposal."""
        assert self.dice_loss is not None
        xyz, offsets, probs = inputs['points'][:, :3], inputs['batch_offsets'], output.logits.softmax(dim=1)
        masks = instance_masks(xyz, offsets, probs, output.votes, targets, labels, self.vote_head.mean_sizes)
        each = [self.dice_loss(mask, member.expand_as(mask)) for mask, member in masks]
        return torch.stack(each).mean() if each else 0.0 * output.logits.sum()

    @torch.no_grad()
    def predict(
        self, inputs: dict[str, Tensor], data_samples: Sequence[SceneSample] | None = None
    ) -> list[SceneSample]:
        """Fill in the predictions of every scene; fresh samples where none are given. Predictions lie on the CPU."""
        output = self.network(inputs)
        probs = output.logits.softmax(dim=1)
        bounds, ends = inputs['batch_offsets'].tolist(), output.votes.anchor_offsets.tolist()
        samples = [SceneSample() for _ in bounds[1:]] if data_samples is None else list(data_samples)
        for i, sample in enumerate(samples):
            self._fill_boxes(sample, output.votes, probs, slice(ends[i], ends[i + 1]))
            if self.predict_points:
                rows = slice(bounds[i], bounds[i + 1])
                sample.pred_point_probs = probs[rows].cpu()
                sample.pred_point_centers = (inputs['points'][rows, :3] + output.votes.offsets[rows]).cpu()
        return samples

    def _fill_boxes(self, sample: SceneSample, votes: VoteOutput, probs: Tensor, rows: slice) -> None:
        prediction = type(votes.prediction)(*(column[rows] for column in votes.prediction))
        members, group_probs = votes.members[rows], None
        if self.score_by_points:
            there = (members >= 0).sum(dim=1, keepdim=True).clamp_min(1)
            group_probs = gather_groups(probs[:, :-1], members).sum(dim=1) / there
        limits = (self.score_threshold, self.nms_iou, self.max_boxes, self.fuse_iou)
        found = decode_scene(prediction, self.vote_head.mean_sizes, group_probs, *limits)
        sample.pred_bboxes_3d, sample.pred_labels_3d, sample.pred_scores_3d = found
