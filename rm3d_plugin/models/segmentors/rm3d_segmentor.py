"""The segmentor: sparse U-Net, semantic head, optional instance head, and the losses of METHOD 7."""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import torch
from jaxtyping import Float, Num
from mmengine.model import BaseModel
from torch import Tensor

from rm3d_plugin.models.common_points import common_rows
from rm3d_plugin.models.heads.point_labels import PointLabels, join_point_labels
from rm3d_plugin.models.segmentors.chunks import Chunk, Progress
from rm3d_plugin.models.segmentors.instance_dice import soft_instance_masks
from rm3d_plugin.models.segmentors.point_inputs import PointInputs, point_inputs
from rm3d_plugin.models.segmentors.scene_inference import (
    Predict,
    SceneInference,
    average_views,
    by_class_frequency,
    mix_regions,
)
from rm3d_plugin.models.segmentors.scene_instances import scene_instances
from rm3d_plugin.models.view_statistics import kept_statistics
from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import LabelStatistics, SceneError, SceneSample

_COMMON_POINTS = 1000  # METHOD 7


class SegmentorOutput(NamedTuple):
    """What the network computed for a batch.

    Attributes:
        logits: (N, C) class scores.
        offsets: (N, 3) metres from each point to the centre of its instance, or None without an instance head.
    """

    logits: Float[Tensor, 'points classes']
    offsets: Float[Tensor, 'points 3'] | None


def _build(config: dict[str, Any] | None) -> Any:
    return None if config is None else MODELS.build(config)


@MODELS.register_module()
class RM3DSegmentor(BaseModel):
    """Semantic and instance segmentation on a sparse U-Net, trained from (pseudo) point labels.

    ::

        points -> backbone -> features -> semantic head -> logits (C) -> L_WSL, L_Aug
                                  +-----> instance head -> offsets ----> L_o, L_Dice;  at test: clusters -> instances

    L_Seg = L_WSL + L_Aug, L_Ins = L_Seg + L_o (+ L_Dice). Every part but the semantic head may be None; each loss holds
    its own weight.

    Args:
        backbone: Config of a backbone with ``forward(xyz, features, batch_offsets)`` and ``out_channels``;
            ``in_channels`` is filled in from ``inputs``.
        num_classes: C. There is no further class for background: points of no class have no label.
        inputs: Fields of :class:`PointInputs`: what the scans have and what of it the network sees.
        semantic_head: Config of ``SemanticHead``; ``in_channels`` and ``num_classes`` are filled in.
        instance_head: Config of ``PointGroupHead``, or None: semantic segmentation only.
        aug_loss: ``JSAugLoss``, ``MSEAugLoss`` or None; needs an augmented view in the batch.
        dice_loss: ``DiceLoss`` between soft and known masks of instances, or None; needs an instance head.
        thing_classes: Classes that have instances.
        predict_instances: Whether ``predict`` looks for instances, where there is an instance head.
        predict_points: Predict class probabilities and centres of points only; the label hook sets it while it asks
            for pseudo labels, which need no instances and no further views, and have regions of their own.
        inference: Fields of :class:`SceneInference`: chunks for large scenes, voting over views. Default: scenes are
            read whole and once.
        data_preprocessor: ``ScenePreprocessor`` by default.
        init_cfg: As in mmengine.

    Attributes:
        inference: How scenes are read at test time; may be replaced.
        progress: Hands on the chunks of a scene; a command may put a progress bar here.
    """

    def __init__(
        self,
        backbone: dict[str, Any],
        num_classes: int,
        inputs: dict[str, Any] | None = None,
        semantic_head: dict[str, Any] | None = None,
        instance_head: dict[str, Any] | None = None,
        aug_loss: dict[str, Any] | None = {'type': 'JSAugLoss'},  # noqa: B006
        dice_loss: dict[str, Any] | None = None,
        thing_classes: Sequence[int] = (),
        predict_instances: bool = True,
        predict_points: bool = False,
        inference: dict[str, Any] | None = None,
        data_preprocessor: dict[str, Any] | None = None,
        init_cfg: dict[str, Any] | None = None,
    ) -> None:
        super().__init__(data_preprocessor or {'type': 'rm3d_plugin.ScenePreprocessor'}, init_cfg)
        self.num_classes, self.thing_classes = num_classes, tuple(thing_classes)
        if not set(self.thing_classes) <= set(range(num_classes)):
            raise ValueError(f'thing_classes: expected classes 0..{num_classes - 1}, got {self.thing_classes}')
        if dice_loss is not None and instance_head is None:
            raise ValueError('dice_loss compares instances: give an instance_head too, or dice_loss=None')
        self.predict_instances, self.predict_points = predict_instances, predict_points
        self.inference = SceneInference(**(inference or {}))
        self.progress: Progress = iter
        settings: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in (inputs or {}).items()}
        self.inputs = PointInputs(**settings)
        self.backbone = MODELS.build({**backbone, 'in_channels': self.inputs.channels})
        channels = self.backbone.out_channels
        semantic = {'type': 'SemanticHead', **(semantic_head or {})}
        self.semantic_head = MODELS.build({**semantic, 'in_channels': channels, 'num_classes': num_classes})
        self.instance_head = _build(
            None if instance_head is None else {'type': 'PointGroupHead', **instance_head, 'in_channels': channels}
        )
        self.aug_loss, self.dice_loss = _build(aug_loss), _build(dice_loss)

    def set_class_counts(self, counts: Num[Tensor, ' classes']) -> None:
        """Tell how many labels of each class the budget shows; used by ``balance='frequency'``."""
        self.semantic_head.set_class_counts(counts)

    def set_label_statistics(self, statistics: LabelStatistics) -> None:
        """Tell how many labels of each class the budget shows."""
        self.set_class_counts(torch.from_numpy(statistics.class_counts))

    def forward(
        self,
        inputs: dict[str, Tensor],
        data_samples: Sequence[SceneSample] | None = None,
        mode: Literal['loss', 'predict', 'tensor'] = 'tensor',
    ) -> Any:
        """Losses by name, samples with predictions, or the plain :class:`SegmentorOutput`."""
        if mode == 'loss':
            return self.loss(inputs, data_samples or [])
        if mode == 'predict':
            return self.predict(inputs, data_samples)
        if mode == 'tensor':
            return self.network(inputs)
        raise ValueError(f'mode: expected loss, predict or tensor, got {mode}')

    def _features(self, points: Tensor, batch_offsets: Tensor) -> Tensor:
        columns = point_inputs(points, batch_offsets, self.inputs)
        features: Tensor = self.backbone(points[:, :3], columns, batch_offsets)
        return features

    def network(self, inputs: dict[str, Tensor]) -> SegmentorOutput:
        """Run backbone and heads on a batch."""
        return self._heads(self._features(inputs['points'], inputs['batch_offsets']))

    def _heads(self, features: Tensor) -> SegmentorOutput:
        offsets = None if self.instance_head is None else self.instance_head(features)
        return SegmentorOutput(self.semantic_head(features), offsets)

    def loss(self, inputs: dict[str, Tensor], data_samples: Sequence[SceneSample]) -> dict[str, Tensor]:
        """Every term by name, weighted."""
        labels = join_point_labels(data_samples, inputs['batch_offsets'], self.num_classes)
        output = self.network(inputs)
        losses: dict[str, Tensor] = self.semantic_head.loss(output.logits, labels)
        if self.aug_loss is not None and 'aug_points' in inputs:
            losses['loss_aug'] = self._view_loss(inputs, output.logits)
        if self.instance_head is not None:
            losses.update(self.instance_head.loss(output.offsets, inputs['points'][:, :3], labels))
        if self.dice_loss is not None:
            losses['loss_dice'] = self._mask_loss(inputs, output, labels)
        return losses

    def _view_loss(self, inputs: dict[str, Tensor], logits: Tensor) -> Tensor:
        """Agreement of the classes with the augmented view, which leaves the running statistics alone."""
        rows = common_rows(inputs['aug_index'], _COMMON_POINTS)
        with kept_statistics(self.backbone):
            features = self._features(inputs['aug_points'], inputs['aug_batch_offsets'])
        loss: Tensor = self.aug_loss(logits[inputs['aug_index'][rows]], self.semantic_head(features[rows]))
        return loss

    def _mask_loss(self, inputs: dict[str, Tensor], output: SegmentorOutput, labels: PointLabels) -> Tensor:
        """L_Dice averaged over the known instances."""
        assert output.offsets is not None
        xyz, probs = inputs['points'][:, :3], output.logits.softmax(dim=1)
        masks = soft_instance_masks(xyz, output.offsets, probs, inputs['batch_offsets'], labels)
        each = [self.dice_loss(mask, member) for mask, member in masks]
        return torch.stack(each).mean() if each else 0.0 * (output.logits.sum() + output.offsets.sum())

    @torch.no_grad()
    def predict(
        self, inputs: dict[str, Tensor], data_samples: Sequence[SceneSample] | None = None
    ) -> list[SceneSample]:
        """Fill in the predictions of every scene; fresh samples where none are given. Predictions lie on the CPU."""
        bounds = inputs['batch_offsets'].tolist()
        sizes = [last - first for first, last in zip(bounds[:-1], bounds[1:], strict=True)]
        samples = [SceneSample() for _ in sizes] if data_samples is None else list(data_samples)
        scenes = inputs['points'].split(sizes)
        plain = all(self.inference.is_plain(size) for size in sizes)
        together = self._joined(self.network(inputs)).cpu().split(sizes) if plain else None
        for number, (sample, points) in enumerate(zip(samples, scenes, strict=True)):
            xyz = points[:, :3].cpu()
            chunks = self.inference.chunks(xyz.numpy())
            values = self._averaged(points, chunks) if together is None else together[number]
            probs, offsets = values[:, : self.num_classes].clone(), values[:, self.num_classes :]
            probs = probs if self.predict_points else self._settled(probs, sample)
            sample.pred_point_probs = probs
            if self.instance_head is None:
                continue
            sample.pred_point_centers = xyz + offsets
            if self.predict_instances and not self.predict_points:
                found = scene_instances(
                    self.instance_head, xyz, offsets, probs, self.thing_classes, chunks, self.inference.stitch_iou
                )
                sample.pred_instance_masks = torch.from_numpy(found.masks)
                sample.pred_instance_labels = torch.from_numpy(found.labels)
                sample.pred_instance_scores = torch.from_numpy(found.scores)
        return samples

    def _settled(self, probs: Tensor, sample: SceneSample) -> Tensor:
        """What regions and how often classes are have to say to the network's probabilities."""
        if self.inference.superpoint_smoothing:
            if 'pts_region' not in sample:
                raise SceneError(
                    f'scene {sample.get("scene_id", "")}: inference.superpoint_smoothing wants pts_region of each '
                    'point; put RegionNumbers into the pipeline, or set superpoint_smoothing=0'
                )
            probs = mix_regions(probs, sample.pts_region.cpu(), self.inference.superpoint_smoothing)
        if self.inference.logit_adjustment:
            probs = by_class_frequency(probs, self.semantic_head.class_counts.cpu(), self.inference.logit_adjustment)
        return probs

    @staticmethod
    def _joined(output: SegmentorOutput) -> Float[Tensor, 'points values']:
        """Probabilities, then offsets where there are any."""
        probs = output.logits.softmax(dim=1)
        return probs if output.offsets is None else torch.cat([probs, output.offsets], dim=1)

    def _averaged(self, points: Tensor, chunks: Sequence[Chunk]) -> Float[Tensor, 'points values']:
        """The same for a scene in chunks, from each of the views."""
        if not chunks:
            return self._joined(self.network({'points': points, 'batch_offsets': points.new_zeros(2).long()})).cpu()
        views = self.inference.one_view if self.predict_points else self.inference.views
        return average_views(points, views, chunks, self._look, self.num_classes, self.progress)

    def _look(self, points: Tensor) -> Predict:
        """A view of a scene, as a function that predicts some of its rows.

        What a point is told of its place in the scene is the same in every chunk.
        """
        columns = point_inputs(points, torch.tensor([0, len(points)], device=points.device), self.inputs)

        def predict(rows: Tensor) -> Tensor:
            rows = rows.to(points.device)
            ends = torch.tensor([0, len(rows)], device=points.device)
            return self._joined(self._heads(self.backbone(points[rows, :3], columns[rows], ends)))

        return predict
