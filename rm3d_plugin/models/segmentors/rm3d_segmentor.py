"""The segmentor: sparse U-Net, semantic head, optional instance head, and the losses of METHOD 7."""

from collections.abc import Sequence
from typing import Any, final

import torch
from mmengine.structures import BaseDataElement
from torch import Tensor

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.heads.point_labels import PointLabels, join_point_labels
from rm3d_plugin.models.outputs import SegmentorOutput
from rm3d_plugin.models.point_model import LossConfigs, PointModel
from rm3d_plugin.models.segmentors.chunks import Progress
from rm3d_plugin.models.segmentors.point_inputs import PointInputs, point_inputs
from rm3d_plugin.models.segmentors.scene_inference import Refine, SceneInference
from rm3d_plugin.models.segmentors.scene_instances import scene_instances
from rm3d_plugin.models.segmentors.scene_reader import SceneReader, settled
from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import LabelStatistics


def segmentation_losses(instances: bool) -> LossConfigs:
    """L_Seg = L_WSL + L_Aug or, with instances, L_Ins = L_Seg + L_o + L_Dice (METHOD 7)."""
    classes = [{'type': 'WeakSupervision'}, {'type': 'ViewConsistency'}]
    return [*classes, {'type': 'InstanceOffsets'}, {'type': 'InstanceDice'}] if instances else classes


@MODELS.register_module()
@final
class RM3DSegmentor(PointModel):
    """Semantic and instance segmentation on a sparse U-Net, trained from (pseudo) point labels.

    ::

        points -> backbone -> features -> semantic head -> logits (C) -> L_WSL, L_Aug
                                  +-----> instance head -> offsets ----> L_o, L_Dice;  at test: clusters -> instances

    Args:
        backbone: Config of a backbone with ``forward(xyz, features, batch_offsets)`` and ``out_channels``;
            ``in_channels`` is filled in from ``inputs``.
        num_classes: C. There is no further class for background: points of no class have no label.
        inputs: Fields of :class:`PointInputs`: what the scans have and what of it the network sees.
        semantic_head: Config of ``SemanticHead``; ``in_channels`` and ``num_classes`` are filled in.
        instance_head: Config of ``PointGroupHead``, or None: semantic segmentation only.
        losses: Configs of :class:`LossTerm`; None among them is left out. By default :func:`segmentation_losses`.
        thing_classes: Classes that have instances.
        predict_instances: Whether ``predict`` looks for instances, where there is an instance head. While
            ``predict_points`` is set it does not, as pseudo labels need none.
        inference: Fields of :class:`SceneInference`: chunks for large scenes, voting over views. Default: scenes are
            read whole and once.
        refine: Config of a part that is called with points and class probabilities of a scene, on the CPU, and returns
            better ones; at test time alone, after ``inference``. None: nothing is refined.
        ignore_index: A further value of ``pts_semantic_mask`` that means unlabelled, besides -1: ``num_classes`` in
            mmdetection3d.
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
        losses: LossConfigs | None = None,
        thing_classes: Sequence[int] = (),
        predict_instances: bool = True,
        inference: dict[str, Any] | None = None,
        refine: dict[str, Any] | None = None,
        ignore_index: int | None = None,
        data_preprocessor: dict[str, Any] | None = None,
        init_cfg: dict[str, Any] | None = None,
    ) -> None:
        settings: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in (inputs or {}).items()}
        if settings.get('columns', ()) is None:
            raise ValueError('inputs.columns: None is filled in from the scans when training begins; name them here')
        columns = PointInputs(**settings)
        super().__init__(backbone, columns.channels, data_preprocessor, init_cfg)
        self.inputs, self.num_classes, self.thing_classes = columns, num_classes, tuple(thing_classes)
        if not all(0 <= number < num_classes for number in self.thing_classes):
            raise ValueError(f'thing_classes: expected classes 0..{num_classes - 1}, got {self.thing_classes}')
        self.predict_instances, self.ignore_index = predict_instances, ignore_index
        self.inference = SceneInference(**(inference or {}))
        self.refine: Refine | None = None if refine is None else MODELS.build(refine)
        self.progress: Progress = iter
        channels, given = self.backbone.out_channels, {*SegmentorOutput._fields, *PointLabels._fields}
        semantic = {'type': 'SemanticHead', **(semantic_head or {})}
        self.semantic_head = MODELS.build({**semantic, 'in_channels': channels, 'num_classes': num_classes})
        self.instance_head = None
        if instance_head is None:
            given.remove('offsets')
        else:
            self.instance_head = MODELS.build({'type': 'PointGroupHead', **instance_head, 'in_channels': channels})
        self.add_losses(segmentation_losses(instance_head is not None) if losses is None else losses, given)

    def set_label_statistics(self, statistics: LabelStatistics) -> None:
        """How often each class is annotated, for ``balance='frequency'`` and ``inference.logit_adjustment``."""
        self.semantic_head.set_class_counts(torch.from_numpy(statistics.class_counts))

    def encode(self, points: Tensor, batch_offsets: Tensor) -> Tensor:
        """Features (N, F) of the points of a batch."""
        columns = point_inputs(points, batch_offsets, self.inputs)
        features: Tensor = self.backbone(points[:, :3], columns, batch_offsets)
        return features

    def classify(self, features: Tensor) -> Tensor:
        """Logits (N, C)."""
        logits: Tensor = self.semantic_head(features)
        return logits

    def network(self, batch: Batch) -> SegmentorOutput:
        """Run backbone and heads on a batch."""
        return self._heads(self.encode(batch.points, batch.batch_offsets))

    def _heads(self, features: Tensor) -> SegmentorOutput:
        offsets = None if self.instance_head is None else self.instance_head(features)
        return SegmentorOutput(features, self.classify(features), offsets)

    def labels(self, samples: Sequence[BaseDataElement], batch: Batch, outputs: SegmentorOutput) -> PointLabels:
        """Classes and instances of the points."""
        labels = join_point_labels(samples, batch.batch_offsets, self.num_classes, self.ignore_index)
        return labels._replace(class_counts=self.semantic_head.class_counts)

    def predict(self, batch: Batch, samples: list[BaseDataElement]) -> None:
        """Class probabilities and, with an instance head, centres and instances.

        With ``predict_points`` they are what making labels needs: read from one side, as the network says them, without
        instances, and with ``predict_features`` the features beside them.
        """
        columns = self.backbone.out_channels if self.predict_points and self.predict_features else 0
        reader = SceneReader(
            self.inputs, self.num_classes, columns, self.inference, self.backbone, self._heads, self.progress
        )
        scenes = reader.read(batch, once=self.predict_points)
        for sample, points, scene in zip(samples, batch.points.split(batch.sizes), scenes, strict=True):
            probs = scene.probs
            if not self.predict_points:
                probs = settled(probs, sample, self.inference, self.semantic_head.class_counts.cpu())
                probs = probs if self.refine is None else self.refine(points.cpu(), probs)
            sample.pred_point_probs = probs
            if scene.features is not None:
                sample.pred_point_features = scene.features
            if scene.offsets is None:
                continue
            sample.pred_point_centers = scene.xyz + scene.offsets
            if self.predict_instances and not self.predict_points:
                found = scene_instances(self.instance_head, scene, probs, self.thing_classes, self.inference.stitch_iou)
                sample.pred_instance_masks = torch.from_numpy(found.masks)
                sample.pred_instance_labels = torch.from_numpy(found.labels)
                sample.pred_instance_scores = torch.from_numpy(found.scores)
