"""A loss of labels, on what the network says of a further view."""

from typing import Any, NamedTuple

from jaxtyping import Float, Int
from torch import Tensor

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.heads.point_labels import PointLabels
from rm3d_plugin.models.losses.loss_term import LossTerm
from rm3d_plugin.models.outputs import PointOutput
from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import UNLABELLED


class ViewOutput(NamedTuple):
    """What the network says of the points of a view.

    Attributes:
        features: Of the backbone.
        logits: Class scores.
    """

    features: Float[Tensor, 'view channels']
    logits: Float[Tensor, 'view classes']


@MODELS.register_module()
class ViewSupervision(LossTerm):
    """The values of another loss term, asked of the first further view; none where a batch has no view.

    Args:
        loss: Config of a loss term that reads features, logits and labels of points, such as ``WeakSupervision``; its
            values get ``_view`` behind their names.
    """

    def __init__(self, loss: dict[str, Any]) -> None:
        super().__init__()
        self.loss = MODELS.build(loss)
        self.needs = self.loss.needs

    def forward(self, batch: Batch, outputs: PointOutput, labels: PointLabels) -> dict[str, Tensor]:
        """The loss, with the labels of the points that the view has."""
        found: dict[str, Tensor] = {}
        for view in batch.views[:1]:
            said = ViewOutput(view.features, view.logits())
            values = self.loss(batch, said, labels_of_rows(labels, view.point_ids))
            found |= {f'{name}_view': value for name, value in values.items()}
        return found


def labels_of_rows(labels: PointLabels, rows: Int[Tensor, ' rows']) -> PointLabels:
    """The labels of some points; what speaks of the training set stays.

    Args:
        labels: Of a batch.
        rows: -1: of no point, without a label.
    """
    none = rows < 0

    def taken(values: Tensor, fill: int | bool | float) -> Tensor:
        return values[rows.clamp_min(0)].masked_fill(none, fill)

    return labels._replace(
        semantic=taken(labels.semantic, UNLABELLED),
        instance=taken(labels.instance, UNLABELLED),
        is_annotated=taken(labels.is_annotated, False),
        confidence=None if labels.confidence is None else taken(labels.confidence, 0.0),
    )
