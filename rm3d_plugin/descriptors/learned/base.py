"""What learned descriptors share: weights that fingerprints see, units from the scan, tiles."""

import json
from abc import abstractmethod
from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, final

import numpy as np
import torch
from jaxtyping import Float, Int
from mmengine.logging import print_log

from rm3d_plugin.descriptors.base import Descriptor
from rm3d_plugin.descriptors.learned.tiles import Tile, describe_tiles, make_blocks, make_tiles
from rm3d_plugin.descriptors.learned.weights_file import SHIPPED, TrainedWeights, build_network, read_weights
from rm3d_plugin.ops.sites import CHANNELS, Sites
from rm3d_plugin.structures import Descriptors, PointCloud
from rm3d_plugin.user_error import ConfigError

MAX_SITES = 60_000  # of a tile's core


class LearnedDescriptor(Descriptor):
    """A network that was trained on scans describes sites, and each point takes what is said of its own.

    ::

        cloud -> sites (places in units of its own density, inputs) -> tiles with all that reaches them -> network
        points <- the site of each <----------------------------------------------------------------------+

    The network is a registered part with ``describe(points, batch_offsets) -> (n, F)`` (points: places, then inputs)
    and ``reach``, how far it sees in units of the places. So values do not depend on the tiles, but for rounding
    (1e-5). A subclass is final and says where its sites are.

    Args:
        checkpoint: Of ``rm3d train`` by a config of ``configs/descriptors``: ``epoch_*.pth`` or ``descriptor.npz``.
            None: the weights that come with the package.
        voxel_size: Metres, the unit of the network; None: from each scan, by the distance between its points.
        device: 'cpu', 'cuda', ...
        max_sites: Sites of a tile's core; smaller: less memory, slower. Does not change the values.

    Attributes:
        network_type: Registered name of the networks that it takes.
        backbone_type: Registered name of their backbones.
        in_channels: Inputs of a site, which a checkpoint must agree with; None: not checked.
        blocks: Whether the network says ``block``, the edge of the cubes of a fixed grid that it sees one by one, since
            nothing bounds its reach within one.
        weights: Of the network, arrays by name.
        model: Config of the network, JSON.

    Raises:
        ConfigError: The checkpoint cannot be read, or is of something else.
    """

    network_type: ClassVar[str]
    backbone_type: ClassVar[str] = 'SparseUNet'
    in_channels: ClassVar[int | None] = None
    blocks: ClassVar[bool] = False

    def __init__(
        self,
        checkpoint: str | Path | None = None,
        voxel_size: float | None = None,
        device: str = 'cpu',
        max_sites: int = MAX_SITES,
    ) -> None:
        if voxel_size is not None and not voxel_size > 0:
            raise ValueError(f'{type(self).__name__}.voxel_size: expected metres above 0 or None, got {voxel_size}')
        if max_sites < 1:
            raise ValueError(f'{type(self).__name__}.max_sites: expected at least 1, got {max_sites}')
        self._path = self.shipped() if checkpoint is None else Path(checkpoint)
        trained = read_weights(self._path)
        kinds = [_type_of(part) for part in (trained.model, trained.model.get('backbone'))]
        if kinds != [self.network_type, self.backbone_type]:
            raise ConfigError(
                f'{self._path}: holds a {kinds[0]} of a {kinds[1]}; {type(self).__name__} expected a '
                f'{self.network_type} of a {self.backbone_type}'
            )
        inputs = trained.model.get('in_channels', CHANNELS)
        if self.in_channels is not None and inputs != self.in_channels:
            raise ConfigError(
                f'{self._path}: its network reads {inputs} inputs of a site; {type(self).__name__} expected '
                f'{self.in_channels}: it was trained for another descriptor'
            )
        if checkpoint is None:
            print_log(f'{type(self).__name__}: with the weights of the package, {self._path.name}', logger='current')
        self.weights = trained.arrays
        self.model = json.dumps(trained.model, sort_keys=True)
        self.voxel_size = voxel_size
        self._device, self._max_sites = device, max_sites

    @final
    @classmethod
    def shipped(cls) -> Path:
        """The weights that come with the package."""
        return SHIPPED / f'{cls.__name__.lower()}.npz'

    @abstractmethod
    def sites(self, cloud: PointCloud) -> Sites:
        """Where a cloud is described, and what the network sees there."""

    @final
    def compute(self, cloud: PointCloud) -> Descriptors:
        """Describe every point of a cloud; those whose site has too little around it are not valid."""
        return self.describe(self.sites(cloud))

    @final
    def describe(self, sites: Sites) -> Descriptors:
        """Describe the points of sites that were made before, as :meth:`sites` makes them.

        Args:
            sites: Of a cloud.
        """
        points = np.concatenate([sites.places, sites.inputs], axis=1)

        def describe(rows: Int[np.ndarray, ' rows']) -> Float[np.ndarray, 'rows features']:
            part = torch.from_numpy(points[rows]).to(self._device)
            offsets = torch.tensor([0, len(rows)], device=part.device)
            with torch.no_grad():
                return self._network.describe(part, offsets).float().cpu().numpy()

        values = describe_tiles(self._tiles(sites.places), len(sites.places), describe)
        values[~sites.valid] = 0.0
        return Descriptors(values, sites.valid[sites.rows], sites.rows)

    def _tiles(self, places: Float[np.ndarray, 'sites 3']) -> Iterable[Tile]:
        reach = self._network.reach
        return (
            make_blocks(places, reach, self._network.block)
            if self.blocks
            else make_tiles(places, reach, self._max_sites)
        )

    @cached_property
    def _network(self) -> Any:
        network = build_network(TrainedWeights(json.loads(self.model), self.weights), self._path)
        return network.to(torch.device(self._device))


def _type_of(part: Any) -> str:
    return str(part.get('type')).rpartition('.')[2] if isinstance(part, dict) else 'None'
