"""A network that learns its backbone from views, without heads and labels."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from jaxtyping import Float
from mmengine.model import BaseModel
from mmengine.structures import BaseDataElement
from torch import Tensor

from rm3d_plugin.models.losses.loss_term import LossTerm
from rm3d_plugin.models.point_model import PointModel


class Encoded(NamedTuple):
    """What a backbone alone says of a batch.

    Attributes:
        features: (N, F).
    """

    features: Float[Tensor, 'points channels']


class Pretraining(BaseModel):
    """Runs the backbone of a network, and its losses on the features.

    Args:
        network: A segmentor or a detector whose losses read ``features`` and the views of a batch alone.

    Raises:
        ValueError: A loss reads more.
    """

    def __init__(self, network: PointModel) -> None:
        super().__init__(network.data_preprocessor)
        self.network = network
        for name, term in network.losses.items():
            assert isinstance(term, LossTerm)
            if further := set(term.needs) - {*Encoded._fields}:
                raise ValueError(f'pre-training: {name} reads {", ".join(sorted(further))}; expected features alone')

    def forward(
        self,
        inputs: dict[str, Any],
        data_samples: Sequence[BaseDataElement] | None = None,
        mode: str = 'loss',
    ) -> dict[str, Tensor]:
        """Losses by name; the samples are not read."""
        batch = self.network.join(inputs)
        outputs = Encoded(self.network.encode(batch.points, batch.batch_offsets))
        found: dict[str, Tensor] = {}
        for term in self.network.losses.values():
            found |= term(batch, outputs, None)
        return found
