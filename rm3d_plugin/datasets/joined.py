"""Several data sets as one: rooms and streets, say."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from torch.utils.data import Dataset

from rm3d_plugin.datasets.base import SceneDataset
from rm3d_plugin.registry import DATASETS


@DATASETS.register_module()
class JoinedScenes(Dataset[dict[str, Any]]):
    """The scenes of several data sets, one after the other; an item knows its epoch, as those of one do.

    Args:
        scenes: Configs of data sets; steps of a ``pipeline`` of their own come first.
        pipeline: Of all of them.
        seed: Of the items' generators.
    """

    def __init__(self, scenes: Sequence[Mapping[str, Any]], pipeline: Sequence[Any] = (), seed: int = 0) -> None:
        self.parts: list[SceneDataset] = [
            DATASETS.build({**part, 'pipeline': [*part.get('pipeline', ()), *pipeline], 'seed': seed + number})
            for number, part in enumerate(scenes)
        ]

    @property
    def metainfo(self) -> dict[str, Any]:
        """What mmengine asks for; there are no classes in common."""
        return {'classes': (), 'dataset_type': type(self).__name__}

    def find_scenes(self) -> tuple[str, ...]:
        """Names of all scenes.

        Raises:
            DatasetNotFoundError: A data set is not there.
        """
        return tuple(name for part in self.parts for name in part.find_scenes())

    def full_init(self) -> None:
        """Find the scenes of all parts."""
        for part in self.parts:
            part.full_init()

    def __len__(self) -> int:
        return sum(map(len, self.parts))

    def __getitem__(self, item: int) -> dict[str, Any]:
        """One item; ``item = epoch * len(self) + index``, so a plain index is epoch 0."""
        if item < 0 or len(self) == 0:
            raise IndexError(f'item {item} of {len(self)} scenes')
        epoch, index = divmod(int(item), len(self))
        ends = np.cumsum([len(part) for part in self.parts])
        number = int(np.searchsorted(ends, index, side='right'))
        part = self.parts[number]
        return part[epoch * len(part) + index - int(ends[number]) + len(part)]
