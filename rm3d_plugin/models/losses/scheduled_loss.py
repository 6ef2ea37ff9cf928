"""Loss terms that begin late, or whose weight rises."""

import math
from collections.abc import Sequence
from typing import Any

from torch import Tensor, nn

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.consistency import training_progress
from rm3d_plugin.models.losses.loss_term import LossTerm
from rm3d_plugin.registry import MODELS


def ramp_up(done: float, length: float) -> float:
    """exp(-5 (1 - done / length)^2) until ``length``, then 1: a ramp of consistency losses (Laine, Aila, ICLR 2017).

    >>> [round(ramp_up(done, 0.1), 3) for done in (0.0, 0.05, 0.1, 0.5)]
    [0.007, 0.287, 1.0, 1.0]
    """
    return 1.0 if done >= length else math.exp(-5.0 * (1.0 - done / length) ** 2)


@MODELS.register_module()
class ScheduledLoss(LossTerm):
    """The values of other loss terms times a weight that rises; before ``start`` there are none.

    Args:
        losses: Configs of loss terms.
        start: Share of the epochs after which they begin.
        ramp: Share of the epochs over which their weight then rises to 1; see :func:`ramp_up`. 0: at once.

    Raises:
        ValueError: A share outside [0, 1].
    """

    def __init__(self, losses: Sequence[dict[str, Any]], start: float = 0.0, ramp: float = 0.0) -> None:
        super().__init__()
        if not (0 <= start <= 1 and 0 <= ramp <= 1):
            raise ValueError(f'ScheduledLoss: expected start and ramp in [0, 1], got {start} and {ramp}')
        terms: list[LossTerm] = [MODELS.build(loss) for loss in losses]
        self.losses = nn.ModuleList(terms)
        self.needs = tuple(dict.fromkeys(name for term in terms for name in term.needs))
        self.start, self.ramp = start, ramp

    def forward(self, batch: Batch, outputs: Any, labels: Any) -> dict[str, Tensor]:
        """The weighted values; what is logged only is left as it is."""
        done = training_progress()
        if done < self.start:
            return {}
        weight = ramp_up(done - self.start, self.ramp)
        values = [value for term in self.losses for value in term(batch, outputs, labels).items()]
        return {name: weight * value if 'loss' in name else value for name, value in values}
