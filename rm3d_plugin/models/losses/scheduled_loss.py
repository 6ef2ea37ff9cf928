"""A loss term that begins late, or whose weight rises."""

import math
from typing import Any

from torch import Tensor

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.consistency import training_progress
from rm3d_plugin.models.losses.loss_term import LossTerm
from rm3d_plugin.registry import MODELS


def ramp_up(done: float, length: float) -> float:
    """exp(-5 (1 - done / length)^2) until ``length``, then 1: the ramp of consistency losses (Laine and Aila, ICLR 2017).

    >>> [round(ramp_up(done, 0.1), 3) for done in (0.0, 0.05, 0.1, 0.5)]
    [0.007, 0.287, 1.0, 1.0]
    """
    return 1.0 if done >= length else math.exp(-5.0 * (1.0 - done / length) ** 2)


@MODELS.register_module()
class ScheduledLoss(LossTerm):
    """The values of another loss term times a weight that rises; before ``start`` there are none.

    Args:
        loss: Config of a loss term.
        start: Share of the epochs after which it begins.
        ramp: Share of the epochs over which its weight then rises to 1; see :func:`ramp_up`. 0: at once.

    Raises:
        ValueError: A share outside [0, 1].
    """

    def __init__(self, loss: dict[str, Any], start: float = 0.0, ramp: float = 0.0) -> None:
        super().__init__()
        if not (0 <= start <= 1 and 0 <= ramp <= 1):
            raise ValueError(f'ScheduledLoss: expected start and ramp in [0, 1], got {start} and {ramp}')
        self.loss = MODELS.build(loss)
        self.needs = self.loss.needs
        self.start, self.ramp = start, ramp

    def forward(self, batch: Batch, outputs: Any, labels: Any) -> dict[str, Tensor]:
        """The weighted values; what is logged only is left as it is."""
        done = training_progress()
        if done < self.start:
            return {}
        weight = ramp_up(done - self.start, self.ramp)
        values = self.loss(batch, outputs, labels)
        return {name: weight * value if 'loss' in name else value for name, value in values.items()}
