"""A backbone whose features are unit vectors: alike where two scans show the same place."""

from collections.abc import Sequence
from typing import Any, NamedTuple, final

import torch
from jaxtyping import Float, Int
from mmengine.structures import BaseDataElement
from torch import Tensor, nn
from torch.nn.functional import normalize

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.point_model import LossConfigs, PointModel
from rm3d_plugin.ops.sites import CHANNELS
from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import LabelStatistics


class DescriptorOutput(NamedTuple):
    """What a descriptor network says of a batch.

    Attributes:
        features: (N, F) unit vectors.
    """

    features: Float[Tensor, 'points channels']


class SiteLabels(NamedTuple):
    """What is known of the sites of a batch.

    Attributes:
        objects: (N,) number of each site's object, different in each scene; -1 = unknown, everywhere where the
            pipeline hands on no objects.
        classes: (N,) its class; -1 = unknown, everywhere where the pipeline hands on no classes.
    """

    objects: Int[Tensor, ' points']
    classes: Int[Tensor, ' points']


@MODELS.register_module()
@final
class DescriptorNetwork(PointModel):
    """Backbone, a linear layer, unit length.

    It learns from pairs of crops (``CropPairs``, then ``VoxelUnits``): the losses compare ``outputs.features`` with the
    features of the view. Or it learns from objects (``ObjectSites``) or classes (``ClassSites``). Places are in voxels,
    so the backbone has ``voxel_size=1``.

    Args:
        backbone: Config of a backbone that knows how far it sees (``reach``).
        channels: Values of a descriptor.
        in_channels: Inputs of a site, 40 with histograms, 44 with histograms and heights.
        direct: Whether a linear layer of a site's own inputs is added before the length becomes one: what the inputs
            tell alone is learnt at once, the backbone learns what they lack.
        losses: Configs of loss terms that read ``features`` and the views.
        data_preprocessor: As for :class:`PointModel`.
        init_cfg: As in mmengine.
    """

    def __init__(
        self,
        backbone: dict[str, Any],
        channels: int = 32,
        in_channels: int = CHANNELS,
        direct: bool = False,
        losses: LossConfigs = (),
        data_preprocessor: dict[str, Any] | None = None,
        init_cfg: dict[str, Any] | None = None,
    ) -> None:
        super().__init__(backbone, in_channels, data_preprocessor, init_cfg)
        self.projection = nn.Linear(self.backbone.out_channels, channels)
        self.direct = nn.Linear(in_channels, channels, bias=False) if direct else None
        self.add_losses(losses, {*DescriptorOutput._fields, *SiteLabels._fields})

    @property
    def reach(self) -> float:
        """How far, along an axis, lie sites that change what is said of one; voxels."""
        return float(self.backbone.reach)

    def describe(self, points: Tensor, batch_offsets: Tensor) -> Float[Tensor, 'points channels']:
        """Descriptors of the sites of scenes: places, then inputs."""
        return self.encode(points, batch_offsets)

    def encode(self, points: Tensor, batch_offsets: Tensor) -> Float[Tensor, 'points channels']:
        """Unit vectors."""
        inputs = points[:, 3:].contiguous()
        out = self.projection(self.backbone(points[:, :3].contiguous(), inputs, batch_offsets))
        return normalize(out if self.direct is None else out + self.direct(inputs), dim=1)

    def classify(self, features: Tensor) -> Tensor:
        """Refused: no loss of classes fits a network that knows none.

        Raises:
            TypeError: Always.
        """
        raise TypeError('DescriptorNetwork: says no classes; its losses read features')

    def network(self, batch: Batch) -> DescriptorOutput:
        """Describe the first crops."""
        return DescriptorOutput(self.encode(batch.points, batch.batch_offsets))

    def labels(self, samples: Sequence[BaseDataElement], batch: Batch, outputs: DescriptorOutput) -> SiteLabels:
        """Objects and classes of the sites, where the samples have any."""
        count, parts, classes = 0, [], []
        for sample, size in zip(samples, batch.sizes, strict=True):
            objects = sample.get('pts_instance_mask')
            own = torch.full((size,), -1) if objects is None else objects.cpu()
            parts.append(torch.where(own >= 0, own + count, own))
            count += int(own.max()) + 1 if size else 0
            known = sample.get('pts_semantic_mask')
            classes.append(torch.full((size,), -1) if known is None else known.cpu())
        return SiteLabels(*(torch.cat(each).to(batch.points.device) for each in (parts, classes)))

    def predict(self, batch: Batch, samples: list[BaseDataElement]) -> None:
        """Fill in ``pred_descriptors`` (n, F)."""
        features = self.network(batch).features.cpu()
        for sample, rows in zip(samples, features.split(batch.sizes), strict=True):
            sample.set_data({'pred_descriptors': rows})

    def set_label_statistics(self, statistics: LabelStatistics) -> None:
        """Nothing to be told: there are no labels."""
