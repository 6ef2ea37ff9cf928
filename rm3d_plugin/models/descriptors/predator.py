"""Predator: descriptors of two crops that know of each other (Huang et al., CVPR 2021; METHOD 3)."""

from collections.abc import Sequence
from typing import Any, NamedTuple, final

import torch
from jaxtyping import Float
from mmengine.structures import BaseDataElement
from torch import Tensor, nn
from torch.nn.functional import normalize

from rm3d_plugin.models.backbones.layers import SparseFeatures
from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.descriptors.overlap_attention import OverlapAttention
from rm3d_plugin.models.point_model import LossConfigs, PointModel
from rm3d_plugin.ops.sites import CHANNELS
from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import LabelStatistics


class CropOutput(NamedTuple):
    """What is said of the sites of some crops.

    Attributes:
        features: (N, F) unit vectors.
        overlap: (N,) logits of lying where both crops are.
        saliency: (N,) logits of being matched.
    """

    features: Float[Tensor, 'points channels']
    overlap: Float[Tensor, ' points']
    saliency: Float[Tensor, ' points']


class PredatorOutput(NamedTuple):
    """As :class:`CropOutput` for the first crops, and the same of the other ones (None: there are none)."""

    features: Float[Tensor, 'points channels']
    overlap: Float[Tensor, ' points']
    saliency: Float[Tensor, ' points']
    other: CropOutput | None


@MODELS.register_module()
@final
class PredatorNetwork(PointModel):
    """The sparse U-Net with overlap attention between both crops at its coarsest level.

    ::

        crop   -> encoder -> | attention of each to itself | -> decoder -> features, overlap, saliency
        other  -> encoder -> | and to the other crop       | -> decoder -> features, overlap, saliency

    Simpler than the original: the project's sparse convolutions in place of kernel point convolutions, narrower
    layers, three levels. A cloud by itself is its own other crop; METHOD's jittered copy would double the work and make
    chance of it.

    Attention has no bounds, so a cloud is described in cubes of a fixed grid, with a margin: their edge is part of the
    descriptor.

    Args:
        backbone: Config of :class:`SparseUNet` with ``voxel_size=1``.
        channels: Values of a descriptor.
        attention: Arguments of :class:`OverlapAttention` but ``in_channels``.
        block: Voxels; edge of the cubes, about that of the crops of training.
        margin: Voxels around a cube that are seen, too.
        in_channels: Inputs of a site, 40 with histograms.
        direct: As for :class:`DescriptorNetwork`.
        losses: Configs of loss terms.
        data_preprocessor: As for :class:`PointModel`.
        init_cfg: As in mmengine.
    """

    def __init__(
        self,
        backbone: dict[str, Any],
        channels: int = 32,
        attention: dict[str, Any] | None = None,
        block: int = 64,
        margin: int = 16,
        in_channels: int = CHANNELS,
        direct: bool = False,
        losses: LossConfigs = (),
        data_preprocessor: dict[str, Any] | None = None,
        init_cfg: dict[str, Any] | None = None,
    ) -> None:
        super().__init__(backbone, in_channels, data_preprocessor, init_cfg)
        self.block, self.reach = block, float(margin)
        self.attention = OverlapAttention(self.backbone.coarse_channels, **(attention or {}))
        self.head = nn.Linear(self.backbone.out_channels, channels + 2)
        self.direct = nn.Linear(in_channels, channels, bias=False) if direct else None
        self.add_losses(losses, set(PredatorOutput._fields))

    def describe(self, points: Tensor, batch_offsets: Tensor) -> Float[Tensor, 'points channels']:
        """Descriptors of the sites of scenes, each paired with itself."""
        alone = torch.arange(len(batch_offsets) - 1)
        return self._say(points, batch_offsets, alone).features

    def encode(self, points: Tensor, batch_offsets: Tensor) -> Float[Tensor, 'points channels']:
        """As :meth:`describe`."""
        return self.describe(points, batch_offsets)

    def classify(self, features: Tensor) -> Tensor:
        """Refused: it says no classes.

        Raises:
            TypeError: Always.
        """
        raise TypeError('PredatorNetwork: says no classes; its losses read features')

    def network(self, batch: Batch) -> PredatorOutput:
        """Describe the first crops together with those of the first view, or each with itself."""
        scenes = len(batch.batch_offsets) - 1
        if not batch.views:
            return PredatorOutput(*self._say(batch.points, batch.batch_offsets, torch.arange(scenes)), None)
        view = batch.views[0]
        points = torch.cat([batch.points, view.points])
        offsets = torch.cat([batch.batch_offsets, view.batch_offsets[1:] + len(batch.points)])
        both = self._say(points, offsets, torch.arange(2 * scenes).roll(scenes))
        first, second = (
            CropOutput(*(part[rows] for part in both))
            for rows in (slice(None, len(batch.points)), slice(len(batch.points), None))
        )
        return PredatorOutput(*first, second)

    def labels(self, samples: Sequence[BaseDataElement], batch: Batch, outputs: PredatorOutput) -> None:
        """None: pairs teach, not labels."""

    def predict(self, batch: Batch, samples: list[BaseDataElement]) -> None:
        """Fill in ``pred_descriptors`` (n, F)."""
        features = self.network(batch).features.cpu()
        for sample, rows in zip(samples, features.split(batch.sizes), strict=True):
            sample.set_data({'pred_descriptors': rows})

    def set_label_statistics(self, statistics: LabelStatistics) -> None:
        """Nothing to be told: there are no labels."""

    def _say(self, points: Tensor, batch_offsets: Tensor, partners: Tensor) -> CropOutput:
        def meet(coarse: SparseFeatures) -> SparseFeatures:
            return coarse._replace(values=self.attention(coarse.values, coarse.level.coords, partners))

        xyz, inputs = points[:, :3].contiguous(), points[:, 3:].contiguous()
        out = self.head(self.backbone(xyz, inputs, batch_offsets, meet))
        features = out[:, :-2] if self.direct is None else out[:, :-2] + self.direct(inputs)
        return CropOutput(normalize(features, dim=1), out[:, -2], out[:, -1])
