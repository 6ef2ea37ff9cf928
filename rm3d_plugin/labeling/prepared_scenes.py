"""The prepared geometry of a run's scenes, from memory, from the cache, or made now."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed
from tqdm import tqdm

from rm3d_plugin.regions.geometry import SceneGeometry, Seeds
from rm3d_plugin.regions.prepare import PreparedScene
from rm3d_plugin.storage import SceneCache
from rm3d_plugin.storage.recent import RecentItems
from rm3d_plugin.structures import PointCloud

SCENES_IN_MEMORY = 512  # MB of prepared scenes: data sets of some dozen scans are read once


class PreparedScenes:
    """Regions and graphs by scene.

    Args:
        cloud_of: Reads the points of a scene.
        seeds_of: Points from which its over-segmentation starts; None: it chooses.
        cache: Folder of prepared geometry; shared by runs, keyed by content and parameters.
        descriptor: Config of a descriptor provider.
        oversegmenter: Config of an over-segmenter.
        graph_neighbors: K, adjacent regions that each region keeps.
        max_gap: Metres; regions farther apart are not adjacent.
    """

    def __init__(
        self,
        cloud_of: Callable[[str], PointCloud],
        seeds_of: Callable[[str], Seeds],
        cache: str | Path,
        descriptor: Mapping[str, Any],
        oversegmenter: Mapping[str, Any],
        graph_neighbors: int = 8,
        max_gap: float | None = None,
    ) -> None:
        self.cache = SceneCache(cache)
        self._cloud_of, self._seeds_of = cloud_of, seeds_of
        self._geometry = SceneGeometry(self.cache, descriptor, oversegmenter, graph_neighbors, max_gap)
        self._keys: dict[str, str] = {}
        self._recent: RecentItems[PreparedScene] = RecentItems(SCENES_IN_MEMORY, PreparedScene.nbytes)

    def get(self, scene_id: str) -> PreparedScene:
        """Regions and graph of a scene; not to be written to."""
        return self._recent.get_or_make(scene_id, lambda: self._read(scene_id))

    def forget(self) -> None:
        """Regions may start from other points now."""
        self._keys.clear()
        self._recent.clear()

    def _read(self, scene_id: str) -> PreparedScene:
        if scene_id not in self._keys:  # it stays as it is until the budget grows
            self._keys[scene_id] = self._geometry.key(self._cloud_of(scene_id), self._seeds_of(scene_id), scene_id)
        return self._geometry.prepared(
            self._keys[scene_id], lambda: self._cloud_of(scene_id), lambda: self._seeds_of(scene_id), scene_id
        )

    def prepare(self, scene_ids: Iterable[str], jobs: int = 1) -> str:
        """Fill the cache.

        Args:
            scene_ids: Whose geometry.
            jobs: Processes; any joblib backend that is set (dask, say) is used.

        Returns:
            What was done, in a line.
        """
        scenes = list(scene_ids)
        if jobs == 1:
            for scene in tqdm(scenes, desc='preparing geometry'):
                self.get(scene)
        else:
            tasks = (delayed(_prepare_one)(self, scene) for scene in scenes)
            done = Parallel(n_jobs=jobs, return_as='generator_unordered')(tasks)
            for _ in tqdm(done, total=len(scenes), desc=f'preparing geometry, {jobs} processes'):
                pass
        return f'geometry of {len(scenes)} scenes is in {self.cache.root}'


def _prepare_one(scenes: PreparedScenes, scene_id: str) -> None:
    scenes.get(scene_id)
