"""Oakland 3-D point clouds (CMU, 2009) in their native text files."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from rm3d_plugin.datasets.base import DatasetNotFoundError, check_choice
from rm3d_plugin.datasets.oakland_format import CLASSES, merge_ids, read_tile
from rm3d_plugin.datasets.segmentation import RawScene, SegmentationDataset, check_classes
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.storage.written_files import real_path
from rm3d_plugin.structures import PointCloud

Split = Literal['train', 'test']
TILES: dict[str, tuple[str, ...]] = {
    'train': ('part2_ac', 'part2_ad', 'part2_ae', 'part3_aj', 'part3_ak', 'part3_am'),
    'test': ('part2_ag', 'part2_ai', 'part3_ao'),
}
ENDING = '.xyz_label_conf'
KEPT_TILES = 16  # in memory; a tile is 2 MB
_LAYOUT = """
    {root}/
      oakland_part2_ac.xyz_label_conf  ...      one tile a file: x y z label confidence
"""


@DATASETS.register_module()
class OaklandDataset(SegmentationDataset):
    """Oakland: one tile, one scene named ``part2_ac``; metres, z up, no colour, no intensity, no instances.

    Args:
        data_root: Folder of the tiles.
        split: 'train' is part2_ac, ad, ae and part3_aj, ak, am; 'test' is part2_ag, ai and part3_ao.
        tiles: Take these instead of the split's.
        classes: Names of the six classes; their order is fixed.
        common: Arguments of :class:`SegmentationDataset` and :class:`SceneDataset`.

    Raises:
        DatasetNotFoundError: A tile is not there.
        ValueError: A choice that there is not.
    """

    def __init__(
        self,
        data_root: str | Path,
        split: Split = 'train',
        tiles: Sequence[str] | None = None,
        classes: Sequence[str] = CLASSES,
        **common: Any,
    ) -> None:
        check_choice('split', split, get_args(Split))
        super().__init__(split, classes=classes, **common)
        check_classes('Oakland', self.classes, len(CLASSES))
        self.data_root = Path(data_root)
        if isinstance(tiles, str):
            raise ValueError(f'tiles: expected a list of names, got {tiles!r}')
        self.tiles = TILES[split] if tiles is None else tuple(tiles)
        if not self.tiles or len(set(self.tiles)) != len(self.tiles):
            raise ValueError(f'tiles: name at least one, each once; got {list(self.tiles)}')
        self._kept: dict[int, RawScene] = {}

    def find_scenes(self) -> tuple[str, ...]:
        """The tiles, in the order they are named."""
        missing = [tile for tile in self.tiles if not self._file(tile).is_file()]
        if missing:
            root = real_path(self.data_root)
            raise DatasetNotFoundError(
                f'Oakland was looked for at {root}, but there is no {self._file(missing[0]).name}'
                f'{f" ({len(missing)} tiles are missing)" if len(missing) > 1 else ""}. Its home was '
                'https://www.cs.cmu.edu/~vmr/datasets/oakland_3d/cvpr09/doc/; lay the tiles out so:\n'
                f'{_LAYOUT.format(root=root)}\nthen pass --cfg-options data_root=FOLDER, or name others by tiles=[...]'
            )
        return self.tiles

    def read_scene(self, index: int) -> RawScene:
        """Points and merged classes of a tile; the first few stay in memory, since every epoch asks for all."""
        if index in self._kept:
            return self._kept[index]
        scene = self._read_tile(index)
        if len(self._kept) < KEPT_TILES:
            self._kept[index] = scene
        return scene

    def _read_tile(self, index: int) -> RawScene:
        path = self._file(self.scene_ids[index])

        def parse() -> dict[str, np.ndarray]:
            tile = read_tile(path)
            return {'xyz': tile.xyz, 'label': tile.label}

        arrays = self.parsed('oakland', (path,), parse)
        return RawScene(PointCloud(arrays['xyz'].astype(np.float32)), merge_ids(arrays['label'], path))

    def __getstate__(self) -> dict[str, Any]:
        """Without the tiles in memory: they would travel to every data loader process."""
        return super().__getstate__() | {'_kept': {}}

    def _file(self, tile: str) -> Path:
        named = self.data_root / f'oakland_{tile}{ENDING}'
        plain = self.data_root / f'{tile}{ENDING}'
        return plain if plain.is_file() and not named.is_file() else named
