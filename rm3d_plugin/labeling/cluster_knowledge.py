"""What the clusters of all scenes of a detection run tell of each: how like the annotated objects each is."""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from tqdm import tqdm

from rm3d_plugin.labeling.prepared_scenes import PreparedScenes
from rm3d_plugin.ops.boxes import points_in_boxes
from rm3d_plugin.ops.ground import GroundResult, segment_ground
from rm3d_plugin.pseudo_labels import AnnotatedLabels
from rm3d_plugin.pseudo_labels.common.kernel_classifier import evenly_spread
from rm3d_plugin.pseudo_labels.detection.clusters import (
    Likeness,
    ObjectClusters,
    fit_likeness,
    object_clusters,
    shapes,
)
from rm3d_plugin.structures.point_cloud import SceneError

SCENES = 200  # with an annotated box, and as many without, whose clusters are looked at at most


class _Fitted(NamedTuple):
    likeness: Likeness
    annotated: dict[str, Float[np.ndarray, ' boxes']]


class ClusterKnowledge:
    """Likeness of clusters to annotated objects, learnt at first use from up to 200 scenes with and 200 without boxes.

    Args:
        scene_ids: All scenes.
        scenes: Their geometry.
        annotated: Gives the annotated labels of a scene that training may know.
        sizes: (C, 3) usual sizes of the classes, metres.

    Raises:
        SceneError: Some scenes have intensity or colours, and others have not.
    """

    def __init__(
        self,
        scene_ids: Sequence[str],
        scenes: PreparedScenes,
        annotated: Callable[[str], AnnotatedLabels],
        sizes: Float[np.ndarray, 'classes 3'],
    ) -> None:
        self._scene_ids, self._scenes, self._annotated, self._sizes = scene_ids, scenes, annotated, sizes
        self._tall = float(np.nanmax(sizes[:, 2], initial=0.0))

    @property
    def of_every_class(self) -> bool:
        """Whether annotated objects tell of every class what its objects look like."""
        return self._fitted.likeness.of_every_class

    def of(self, scene_id: str, ground: GroundResult) -> ObjectClusters:
        """Clusters of a scene.

        Args:
            scene_id: The scene.
            ground: Its ground.
        """
        point, rows = self._clusters(scene_id, ground)
        known = self._fitted.annotated.get(scene_id)
        if known is None:  # its objects were not learnt from
            labels, objects = self._annotated(scene_id).boxes.labels, self._objects(scene_id, ground)
            told = self._fitted.likeness.of(objects)[np.arange(len(labels)), labels]
            known = objects.any(axis=1) * np.nan_to_num(told)
        return ObjectClusters(point, self._fitted.likeness.of(rows), known)

    def _clusters(self, scene_id: str, ground: GroundResult) -> tuple[np.ndarray, np.ndarray]:
        """Cluster of each point, and what the clusters look like."""
        cloud = self._scenes.get(scene_id).cloud
        point = object_clusters(cloud.xyz, ground.height, ground.is_ground, self._sizes)
        return point, shapes(cloud, ground.height, point, int(point.max(initial=-1)) + 1, self._tall)

    def _objects(self, scene_id: str, ground: GroundResult) -> np.ndarray:
        """What the annotated objects of a scene look like; zeros for one without points."""
        cloud, boxes = self._scenes.get(scene_id).cloud, self._annotated(scene_id).boxes
        inside = np.where(ground.is_ground, -1, points_in_boxes(cloud.xyz, boxes.tensor))
        return shapes(cloud, ground.height, inside, len(boxes), self._tall)

    @cached_property
    def _fitted(self) -> _Fitted:
        groups: tuple[list[str], list[str]] = ([], [])
        for scene in self._scene_ids:
            groups[len(self._annotated(scene).boxes) > 0].append(scene)
        chosen = [group[row] for group in groups for row in evenly_spread(len(group), SCENES)]
        clusters, objects, labels = [], [], []
        for scene in tqdm(chosen, desc='what clusters look like', leave=False):
            ground = segment_ground(self._scenes.get(scene).cloud.xyz)
            clusters.append(self._clusters(scene, ground)[1])
            objects.append(self._objects(scene, ground))
            labels.append(self._annotated(scene).boxes.labels)
        for scene, part in zip(chosen, clusters, strict=True):
            if part.shape[1] != clusters[0].shape[1]:
                raise SceneError(
                    f'{scene}: expected intensity and colours as in {chosen[0]}, since what objects look like is '
                    'compared over all scenes; give all scenes the same, or set predicted_boxes.least_likeness=0'
                )
        rows, of = np.concatenate(objects), np.concatenate(labels)
        seen = rows.any(axis=1)
        likeness, left_out = fit_likeness(rows[seen], of[seen], np.concatenate(clusters), len(self._sizes))
        every = np.zeros(len(rows))
        every[seen] = left_out
        parts = np.split(every, np.cumsum([len(part) for part in labels])[:-1])
        return _Fitted(likeness, dict(zip(chosen, parts, strict=True)))
