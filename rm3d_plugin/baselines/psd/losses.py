"""Relations of labelled points (perturbed self-distillation, ICCV 2021)."""

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor, nn

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.consistency import common_rows
from rm3d_plugin.models.heads import PointLabels
from rm3d_plugin.models.losses import LossTerm, labels_of_rows
from rm3d_plugin.models.outputs import PointOutput
from rm3d_plugin.registry import MODELS

_EPS = 1e-4  # of the released code


def relation_loss(features: Float[Tensor, 'points channels'], classes: Int[Tensor, ' points']) -> Float[Tensor, '']:
    """How well cosines between points, cut off at 0, tell which are of one class.

    Binary cross-entropy over all pairs, plus -log of precision and -log of recall, where each row of the matrix of
    cosines is a soft answer to "who is of my class?"; 0 for no points.

    Args:
        features: Not all zero; any length.
        classes: From 0.
    """
    if len(classes) == 0:
        return 0.0 * features.sum()
    unit = F.normalize(features, dim=1)
    said = (unit @ unit.T).clamp(_EPS, 1.0 - _EPS)
    same = (classes[:, None] == classes).to(said)
    shared = (said * same).sum(dim=1)
    precision, recall = shared / said.sum(dim=1), shared / same.sum(dim=1)
    return F.binary_cross_entropy(said, same) - precision.log().mean() - recall.log().mean()


@MODELS.register_module()
class RelationLoss(LossTerm):
    """``loss_relation``: relations of the labelled points; ``loss_relation_view``: in the first further view.

    Args:
        channels: Features of the backbone, and of the embedding whose cosines are relations.
        num_points: Labelled points of a batch whose relations are learnt, at most.
    """

    needs = ('features', 'semantic')

    def __init__(self, channels: int, num_points: int = 1024) -> None:
        super().__init__()
        self.embed = nn.Linear(channels, channels)
        self.num_points = num_points

    def forward(self, batch: Batch, outputs: PointOutput, labels: PointLabels) -> dict[str, Tensor]:
        """Both losses; 0 where a batch has no label, and the first alone where it has no view."""
        found = {'loss_relation': self._relation(outputs.features, labels.semantic)}
        for view in batch.views[:1]:
            classes = labels_of_rows(labels, view.point_ids).semantic
            found['loss_relation_view'] = self._relation(view.features, classes)
        return found

    def _relation(self, features: Tensor, classes: Tensor) -> Tensor:
        labelled = torch.nonzero(classes >= 0).flatten()
        rows = labelled[common_rows(labelled, self.num_points)]
        return relation_loss(self.embed(features[rows].float()), classes[rows])
