"""Class scores of points (METHOD 7)."""

from collections.abc import Sequence

import torch
from jaxtyping import Float, Num
from mmengine.model import BaseModule
from torch import Tensor, nn

from rm3d_plugin.models.init_config import InitConfig
from rm3d_plugin.registry import MODELS


@MODELS.register_module()
class SemanticHead(BaseModule):
    """A linear layer on the features of points.

    Args:
        in_channels: Columns of the features.
        num_classes: C.
        class_counts: Annotated labels of each class, where they are known beforehand.
        init_cfg: As in mmengine.

    Attributes:
        class_counts: (C,) the same as a tensor, in the checkpoint; zeros until somebody told.
    """

    class_counts: Tensor

    def __init__(
        self, in_channels: int, num_classes: int, class_counts: Sequence[int] | None = None, init_cfg: InitConfig = None
    ) -> None:
        super().__init__(init_cfg)
        self.num_classes = num_classes
        self.linear = nn.Linear(in_channels, num_classes)
        self.register_buffer('class_counts', torch.zeros(num_classes))
        if class_counts is not None:
            self.set_class_counts(torch.tensor(list(class_counts)))

    def set_class_counts(self, counts: Num[Tensor, ' classes']) -> None:
        """Tell how many labels of each class are annotated in the whole training set.

        Raises:
            ValueError: There is not one count a class.
        """
        if counts.shape != (self.num_classes,):
            raise ValueError(f'SemanticHead: expected {self.num_classes} class counts, got shape {tuple(counts.shape)}')
        self.class_counts.copy_(counts)

    def forward(self, features: Float[Tensor, 'points channels']) -> Float[Tensor, 'points classes']:
        """Logits, float32."""
        logits: Tensor = self.linear(features)
        return logits.float()
