"""L_cls: which classes a scene holds, told from its annotated objects (METHOD 7)."""

from typing import Any

from torch import Tensor

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.heads.batch_labels import BatchLabels
from rm3d_plugin.models.losses.loss_term import LossTerm
from rm3d_plugin.models.outputs import DetectorOutput
from rm3d_plugin.registry import MODELS


@MODELS.register_module()
class SceneClasses(LossTerm):
    """``loss_scene_class`` of a :class:`SceneClassHead`, which training alone needs.

    Args:
        num_classes: Box classes.
        head: Config of the head.
    """

    needs = ('logits', 'boxes', 'box_is_annotated')

    def __init__(self, num_classes: int, head: dict[str, Any] | None = None) -> None:
        super().__init__()
        self.head = MODELS.build({'type': 'SceneClassHead', **(head or {}), 'num_classes': num_classes})

    def forward(self, batch: Batch, outputs: DetectorOutput, labels: BatchLabels) -> dict[str, Tensor]:
        """``loss_scene_class``."""
        found: dict[str, Tensor] = self.head.loss(outputs.logits, labels)
        return found
