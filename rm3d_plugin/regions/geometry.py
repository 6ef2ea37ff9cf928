"""The geometry path of a run: one way to regions for all its scenes, each walked once."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from rm3d_plugin.regions.prepare import PreparedScene, prepare_scene
from rm3d_plugin.registry import DESCRIPTORS, OVERSEGMENTERS
from rm3d_plugin.storage import SceneCache, content_key
from rm3d_plugin.structures import PointCloud

PREPARED_VERSION = 3  # raise it when the geometry path changes, so that older caches are not read

Seeds = Int[np.ndarray, ' seeds'] | None


class SceneGeometry:
    """Prepares scenes with given settings, and keeps them by content, so that all who ask alike share them.

    Args:
        cache: Folder of prepared scenes; None: each is made when it is asked for, and nothing is written.
        descriptor: Config of a descriptor provider.
        oversegmenter: Config of an over-segmenter.
        graph_neighbors: K, adjacent regions that each region keeps.
        max_gap: Metres; regions farther apart are not adjacent.
    """

    def __init__(
        self,
        cache: SceneCache | None,
        descriptor: Mapping[str, Any],
        oversegmenter: Mapping[str, Any],
        graph_neighbors: int = 8,
        max_gap: float | None = None,
    ) -> None:
        self.cache = cache
        self._descriptor = DESCRIPTORS.build(dict(descriptor))
        self._oversegmenter = OVERSEGMENTERS.build(dict(oversegmenter))
        self._graph_neighbors, self._max_gap = graph_neighbors, max_gap
        self._settings = (
            self._descriptor.fingerprint(), self._oversegmenter.fingerprint(), graph_neighbors, max_gap
        )  # fmt: skip

    def key(self, cloud: PointCloud, seeds: Seeds, name: str = 'scene') -> str:
        """What the geometry of a scene depends on: its points, the seeds, and the parts with settings and weights.

        Args:
            cloud: Its points.
            seeds: Points from which its over-segmentation starts.
            name: Names the files of the scene, where descriptor or over-segmenter read one.
        """
        # Not the sensor: who asks with the columns of a scan alone shall find the same regions.
        channels = {'xyz': cloud.xyz, 'intensity': cloud.intensity, 'colors': cloud.colors}
        regions, features = self._oversegmenter.scene_file(name), self._descriptor.scene_file(name)
        read = [_content(regions)] if features is None else [_content(regions), _content(features)]
        return content_key('prepared', PREPARED_VERSION, channels, self._settings, seeds, *read)

    def prepared(
        self, key: str, cloud: Callable[[], PointCloud], seeds: Callable[[], Seeds], name: str
    ) -> PreparedScene:
        """Regions and graph of a scene, from the cache or made now.

        Args:
            key: Of the scene, see :meth:`key`.
            cloud: Reads its points, where they are needed.
            seeds: Points from which its over-segmentation starts.
            name: Of the scene.
        """

        def make() -> dict[str, np.ndarray]:
            scene = prepare_scene(
                cloud(), self._descriptor, self._oversegmenter, self._graph_neighbors, self._max_gap, seeds(), name=name
            )
            return scene.to_arrays()

        return PreparedScene.from_arrays(make() if self.cache is None else self.cache.get_or_make(key, make))


def _content(path: Path | None) -> np.ndarray | None:
    """Bytes of a file that is there."""
    return np.fromfile(path, dtype=np.uint8) if path is not None and path.is_file() else None
