"""TWIST as a part of a model's list of losses."""

from collections.abc import Sequence
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from rm3d_plugin.baselines.twist.pseudo import TwoWayLabels, pooled, two_way_labels
from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.heads import PointLabels
from rm3d_plugin.models.heads.proposals import ProposalRules, find_instances
from rm3d_plugin.models.losses import LossTerm, OffsetLoss, point_cross_entropy
from rm3d_plugin.models.losses.instance_offsets import offset_targets
from rm3d_plugin.models.outputs import SegmentorOutput
from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import UNLABELLED


@MODELS.register_module()
class TwistLoss(LossTerm):
    """``loss_object``; with a teacher ``loss_pseudo`` and ``loss_pseudo_offset``, of the points without a label.

    ``loss_object`` teaches a classifier of pooled features from the labelled points of known instances.

    Args:
        num_classes: C.
        channels: Features of the backbone.
        thing_classes: Classes that have instances.
        proposals: Fields of :class:`ProposalRules`.
        threshold: See :func:`two_way_labels`.
    """

    needs = ('features', 'logits', 'offsets', 'semantic', 'instance', 'instance_scene')

    def __init__(
        self,
        num_classes: int,
        channels: int,
        thing_classes: Sequence[int],
        proposals: dict[str, Any] | None = None,
        threshold: float = 0.8,
    ) -> None:
        super().__init__()
        self.classify = nn.Linear(channels, num_classes)
        self.offset_loss = OffsetLoss()
        self.thing_classes, self.threshold = tuple(thing_classes), threshold
        self.rules = ProposalRules(**(proposals or {}))

    def forward(self, batch: Batch, outputs: SegmentorOutput, labels: PointLabels) -> dict[str, Tensor]:
        """The losses."""
        found = {'loss_object': self._objects(outputs.features.float(), labels)}
        if batch.teacher is None:
            return found
        pseudo = self._pseudo_labels(batch, batch.teacher.outputs)
        free = labels.semantic < 0
        found['loss_pseudo'] = point_cross_entropy(outputs.logits, pseudo.classes.masked_fill(~free, UNLABELLED))
        count = int(pseudo.objects.max()) + 1 if len(pseudo.objects) else 0
        targets = offset_targets(batch.xyz, pseudo.objects, count)
        taught = free[targets.rows]
        assert outputs.offsets is not None
        found['loss_pseudo_offset'] = self.offset_loss(outputs.offsets[targets.rows[taught]], targets.offsets[taught])
        return found

    def _objects(self, features: Tensor, labels: PointLabels) -> Tensor:
        """Classes of the known instances from their pooled features; 0 where there is none."""
        count = len(labels.instance_scene)
        masks = labels.instance == torch.arange(count, device=features.device)[:, None]
        first = masks.int().argmax(dim=1)  # all points of an instance are of one class
        logits = self.classify(pooled(features, masks))
        return F.cross_entropy(logits, labels.semantic[first], reduction='sum', ignore_index=UNLABELLED) / max(count, 1)

    @torch.no_grad()
    def _pseudo_labels(self, batch: Batch, said: SegmentorOutput) -> TwoWayLabels:
        """Of all scenes; objects are numbered through the batch."""
        assert said.offsets is not None
        parts = [part.split(batch.sizes) for part in (batch.xyz, said.features.float(), said.logits, said.offsets)]
        classes, objects, count = [], [], 0
        for xyz, features, logits, offsets in zip(*parts, strict=True):
            probs = logits.softmax(dim=1)
            places, shifted, shares = (rows.cpu().numpy() for rows in (xyz, xyz + offsets, probs))
            proposals = find_instances(places, shifted, shares, self.thing_classes, self.rules)
            masks = torch.from_numpy(proposals.masks).to(xyz.device)
            own = two_way_labels(probs, masks, self.classify(pooled(features, masks)).softmax(dim=1), self.threshold)
            classes.append(own.classes)
            objects.append(torch.where(own.objects >= 0, own.objects + count, UNLABELLED))
            count += len(masks)
        return TwoWayLabels(torch.cat(classes), torch.cat(objects))
