"""The inexact and the smoothness loss of Xu and Lee (CVPR 2020); the siamese one is a ``ViewConsistency``."""

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor

from rm3d_plugin.baselines.xu_lee.graph import ColourGraph, colour_graph
from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.consistency import common_rows
from rm3d_plugin.models.heads import PointLabels
from rm3d_plugin.models.losses import LossTerm
from rm3d_plugin.models.outputs import PointOutput
from rm3d_plugin.registry import MODELS


def inexact_loss(
    logits: Float[Tensor, 'points classes'], classes: Int[Tensor, ' points'], absent: bool = True
) -> Float[Tensor, '']:
    """Binary cross-entropy between each class's largest logit in a scene and whether a labelled point shows the class.

    Args:
        logits: Of the points of one scene, at least one.
        classes: -1 = unlabelled.
        absent: Whether a class that no labelled point shows counts as absent; False: nothing is known of it.
    """
    tags = torch.zeros_like(logits[0])
    tags[classes[classes >= 0].unique()] = 1.0
    each = F.binary_cross_entropy_with_logits(logits.max(dim=0).values, tags, reduction='none')
    weight = torch.ones_like(tags) if absent else tags
    return (each * weight).sum() / weight.sum().clamp_min(1.0)


def smoothness_loss(logits: Float[Tensor, 'points classes'], graph: ColourGraph) -> Float[Tensor, '']:
    """Weighted squared difference of the class probabilities of neighbours, the mean over edges; 0 for none."""
    probs = logits.softmax(dim=1)
    source, target = (torch.from_numpy(rows).to(logits.device) for rows in (graph.source, graph.target))
    weight = torch.from_numpy(graph.weight).to(logits)
    apart = (probs[source] - probs[target]).square().sum(dim=1)
    return (weight * apart).sum() / max(len(weight), 1)


@MODELS.register_module()
class XuLeeLoss(LossTerm):
    """``loss_inexact`` and ``loss_smooth``, the means over the scenes of a batch.

    Args:
        channels: Columns behind x, y, z that neighbours agree in: 3 colours, 1 intensity, 0 none.
        num_points: Points of each scene whose neighbours are asked.
        absent: See :func:`inexact_loss`.
    """

    needs = ('logits', 'semantic')

    def __init__(self, channels: int = 3, num_points: int = 4096, absent: bool = True) -> None:
        super().__init__()
        self.channels, self.num_points, self.absent = channels, num_points, absent

    def forward(self, batch: Batch, outputs: PointOutput, labels: PointLabels) -> dict[str, Tensor]:
        """Both losses; none where a batch has no point."""
        parts = (part.split(batch.sizes) for part in (batch.points, outputs.logits, labels.semantic))
        scenes = [scene for scene in zip(*parts, strict=True) if len(scene[0])]
        if not scenes:
            return {}
        inexact = [inexact_loss(logits, classes, self.absent) for _, logits, classes in scenes]
        smooth = [smoothness_loss(logits, self._graph(points)) for points, logits, _ in scenes]
        return {'loss_inexact': torch.stack(inexact).mean(), 'loss_smooth': torch.stack(smooth).mean()}

    def _graph(self, points: Tensor) -> ColourGraph:
        columns = points[:, : 3 + self.channels].double().cpu().numpy()
        rows = common_rows(torch.arange(len(points)), self.num_points).numpy()
        return colour_graph(columns, np.sort(rows))
