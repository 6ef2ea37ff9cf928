"""Regions as part of an item: where making labels hands its partition on to those who learn and predict."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rm3d_plugin.datasets.transforms.recent import RecentArrays
from rm3d_plugin.regions.geometry import SceneGeometry
from rm3d_plugin.registry import TRANSFORMS
from rm3d_plugin.storage import SceneCache
from rm3d_plugin.structures import PointCloud

_CHANNELS = {3: (), 4: ('intensity',), 6: ('colors',), 7: ('intensity', 'colors')}  # by the columns of the points


def cloud_of_columns(points: np.ndarray) -> PointCloud:
    """The cloud whose columns these are: x, y, z, then intensity and colour where the scan has them.

    Raises:
        ValueError: Another number of columns, as after a transform that appends some.
    """
    if points.shape[1] not in _CHANNELS:
        raise ValueError(
            f'RegionNumbers: expected the columns of the scan alone ({sorted(_CHANNELS)}), got {points.shape[1]}; '
            'transforms that append columns belong behind it'
        )
    channels, first = {}, 3
    for name in _CHANNELS[points.shape[1]]:
        channels[name] = points[:, first] if name == 'intensity' else points[:, first : first + 3]
        first += 1 if name == 'intensity' else 3
    return PointCloud(points[:, :3], **channels)


@TRANSFORMS.register_module()
class RegionNumbers:
    """Adds ``region`` (n,), the number of each point's region, -1 where it has none.

    Belongs first: before any crop, and before colours or heights change. With the settings of the run's label_maker and
    ``seeds='none'`` there, both read the same partition from the cache.

    Args:
        cache: Folder of prepared scenes; None: nothing is written.
        settings: Further arguments of :class:`~rm3d_plugin.regions.geometry.SceneGeometry`.
    """

    def __init__(self, cache: str | Path | None = None, **settings: Any) -> None:
        self.geometry = SceneGeometry(None if cache is None else SceneCache(cache), **settings)
        self._recent = RecentArrays()

    def __call__(self, results: Mapping[str, Any]) -> dict[str, Any]:
        """Read or make the partition.

        Raises:
            ValueError: The points have other columns than a scan.
        """
        points = results['points']

        def regions() -> np.ndarray:
            cloud = cloud_of_columns(points)
            name = str(results['scene_id'])
            key = self.geometry.key(cloud, None, name)
            return self.geometry.prepared(key, lambda: cloud, lambda: None, name).regions.labels

        return {**results, 'region': self._recent.get_or_make(np.ascontiguousarray(points), regions)}
