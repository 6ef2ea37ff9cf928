"""An entry of a model's list of losses."""

from abc import ABC, abstractmethod
from typing import Any

from torch import Tensor, nn

from rm3d_plugin.models.batch import Batch


class LossTerm(nn.Module, ABC):
    """One term of the loss, or some that belong together.

    Subclass it, register the class with ``MODELS``, and name it in a model's ``losses``. It may have parameters of its
    own; they are trained with the network and lie in the checkpoint under ``losses.CLASS_NAME``.

    Attributes:
        needs: Fields of ``outputs`` and ``labels`` that it reads; a model that lacks one refuses the loss when it is
            built.
    """

    needs: tuple[str, ...] = ()

    @abstractmethod
    def forward(self, batch: Batch, outputs: Any, labels: Any) -> dict[str, Tensor]:
        """Values by name, weighted.

        Args:
            batch: Points and further views.
            outputs: What the network said: ``SegmentorOutput`` or ``DetectorOutput``.
            labels: What is known: ``PointLabels`` of a segmentor, ``BatchLabels`` of a detector; -1 = unknown.

        Returns:
            Scalars. Those whose name holds ``loss`` are added up, the others are logged only.
        """
