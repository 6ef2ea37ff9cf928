"""Which classes are present, told from the points of truly labelled objects (METHOD 7, L_cls)."""

from typing import Any

import torch
from jaxtyping import Bool, Float, Int
from mmengine.model import BaseModule
from torch import Tensor, nn

from rm3d_plugin.models.heads.batch_labels import BatchLabels
from rm3d_plugin.models.init_config import InitConfig
from rm3d_plugin.ops.grouping import batch_index
from rm3d_plugin.registry import MODELS


def max_by_owner(
    values: Float[Tensor, 'rows channels'], owner: Int[Tensor, ' rows'], owners: int
) -> tuple[Float[Tensor, 'owners channels'], Bool[Tensor, ' owners']]:
    """Channel-wise maximum of the rows of each owner, and which owners have any row; zeros for the others.

    Args:
        values: Rows to pool.
        owner: Owner of each row; rows with -1 are left out.
        owners: How many owners there are.
    """
    kept = (owner >= 0).nonzero()[:, 0]
    index = owner[kept][:, None].expand(-1, values.shape[1])
    pooled = values.new_full((owners, values.shape[1]), -torch.inf)
    pooled = pooled.scatter_reduce(0, index, values[kept], reduce='amax', include_self=True)
    present = torch.bincount(owner[kept], minlength=owners) > 0
    return pooled.masked_fill(~present[:, None], 0.0), present


@MODELS.register_module()
class SceneClassHead(BaseModule):
    """Presence of each class in a scene.

    Max pooling of P_out over each truly labelled object gives P_det; a 1x1 convolution and max pooling over the objects
    of a scene give its class presence. A scene without a truly labelled object contributes nothing, and a class counts
    as present if one of the pooled objects has it, so that objects without a label cannot be mistaken for absent.

    Args:
        num_classes: Box classes; P_out has one more, the background.
        loss: Config of the loss; ``SceneClassLoss`` by default.
        init_cfg: As in mmengine.
    """

    def __init__(self, num_classes: int, loss: dict[str, Any] | None = None, init_cfg: InitConfig = None) -> None:
        super().__init__(init_cfg)
        self.num_classes = num_classes
        self.mix = nn.Linear(num_classes + 1, num_classes)  # a 1x1 convolution over rows of objects
        self.loss_fn = MODELS.build(loss or {'type': 'SceneClassLoss'})

    def forward(
        self, point_logits: Float[Tensor, 'points classes_and_one'], labels: BatchLabels
    ) -> tuple[Float[Tensor, 'scenes classes'], Float[Tensor, 'scenes classes']]:
        """Presence logits and presence of the scenes that have a truly labelled object with points."""
        owner = labels.instance
        if len(labels.boxes):
            owner = torch.where((owner >= 0) & labels.box_is_annotated[owner.clamp_min(0)], owner, -1)
        objects, present = max_by_owner(point_logits, owner, len(labels.boxes))
        scene = batch_index(labels.box_offsets)[present]
        scenes = len(labels.box_offsets) - 1
        logits, counted = max_by_owner(self.mix(objects[present]), scene, scenes)
        truth = torch.zeros_like(logits)
        truth[scene, labels.classes[present]] = 1.0
        return logits[counted], truth[counted]

    def loss(
        self, point_logits: Float[Tensor, 'points classes_and_one'], labels: BatchLabels
    ) -> dict[str, Float[Tensor, '']]:
        """The loss by name; 0 (with a gradient path) where no scene counts."""
        logits, truth = self.forward(point_logits, labels)
        return {'loss_scene_class': self.loss_fn(logits, truth)}
