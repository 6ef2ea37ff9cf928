"""What the clusters of all scenes of a detection run tell of each: how like the annotated objects each is."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from tqdm import tqdm

from rm3d_plugin.labeling.prepared_scenes import PreparedScenes
from rm3d_plugin.ops.boxes import points_in_boxes
from rm3d_plugin.ops.ground import GroundResult, segment_ground
from rm3d_plugin.pseudo_labels import AnnotatedLabels
from rm3d_plugin.pseudo_labels.common.kernel_classifier import evenly_spread
from rm3d_plugin.pseudo_labels.detection.clusters import (
    Likeness,
    ObjectClusters,
    described,
    fit_likeness,
    known_mean,
    object_clusters,
    shapes,
)
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.storage.recent import RecentItems
from rm3d_plugin.structures.point_cloud import SceneError

LOOKS_IN_MEMORY = 256  # MB of what clusters look like; further scenes are described again in each round
SCENES = 200  # with an annotated box, and as many without, whose clusters are looked at at most

Rows = Float[np.ndarray, '_things _features']


class _Looks(NamedTuple):
    """What the clusters and the annotated objects of a scene look like: their shapes, and what a descriptor says."""

    clusters: tuple[Rows, ...]
    objects: tuple[Rows, ...]

    def nbytes(self) -> int:
        """Bytes in memory."""
        return sum(part.nbytes for part in self.clusters + self.objects)


class _Fitted(NamedTuple):
    likeness: tuple[Likeness, ...]
    annotated: dict[str, Float[np.ndarray, ' boxes']]


class ClusterKnowledge:
    """Likeness of clusters to annotated objects, learnt at first use from up to 200 scenes with and 200 without boxes.

    Shapes tell one likeness, and the mean descriptor of the points another; their mean counts (a linear opinion pool:
    neither has a veto, for what is once background is not found again).

    Args:
        scene_ids: All scenes.
        scenes: Their geometry.
        annotated: Gives the annotated labels of a scene that training may know.
        sizes: (C, 3) usual sizes of the classes, metres.
        descriptor: Config of a descriptor provider; None: shapes alone.

    Raises:
        SceneError: Some scenes have intensity or colours, and others have not.
    """

    def __init__(
        self,
        scene_ids: Sequence[str],
        scenes: PreparedScenes,
        annotated: Callable[[str], AnnotatedLabels],
        sizes: Float[np.ndarray, 'classes 3'],
        descriptor: Mapping[str, Any] | None = None,
    ) -> None:
        self._scene_ids, self._scenes, self._annotated, self._sizes = scene_ids, scenes, annotated, sizes
        self._tall = float(np.nanmax(sizes[:, 2], initial=0.0))
        self._descriptor = None if descriptor is None else DESCRIPTORS.build(dict(descriptor))
        self._recent: RecentItems[_Looks] = RecentItems(LOOKS_IN_MEMORY, _Looks.nbytes)

    @property
    def of_every_class(self) -> bool:
        """Whether annotated objects tell of every class what its objects look like."""
        return bool(np.any([likeness.known for likeness in self._fitted.likeness], axis=0).all())

    def of(self, scene_id: str, ground: GroundResult) -> ObjectClusters:
        """Clusters of a scene.

        Args:
            scene_id: The scene.
            ground: Its ground.
        """
        looks, fitted = self._looks(scene_id, ground), self._fitted
        known = fitted.annotated.get(scene_id)
        if known is None:  # its objects were not learnt from
            labels = self._annotated(scene_id).boxes.labels
            told = _likeness(fitted.likeness, looks.objects)[np.arange(len(labels)), labels]
            known = looks.objects[0].any(axis=1) * np.nan_to_num(told)
        return ObjectClusters(self._points(scene_id, ground), _likeness(fitted.likeness, looks.clusters), known)

    def _points(self, scene_id: str, ground: GroundResult) -> np.ndarray:
        """Cluster of each point."""
        return object_clusters(self._scenes.get(scene_id).cloud.xyz, ground.height, ground.is_ground, self._sizes)

    def _looks(self, scene_id: str, ground: GroundResult) -> _Looks:
        return self._recent.get_or_make(scene_id, lambda: self._described(scene_id, ground))

    def _described(self, scene_id: str, ground: GroundResult) -> _Looks:
        """What clusters and annotated objects look like; zeros are the shape of an object without points."""
        cloud, boxes = self._scenes.get(scene_id).cloud, self._annotated(scene_id).boxes
        point = self._points(scene_id, ground)
        inside = np.where(ground.is_ground, -1, points_in_boxes(cloud.xyz, boxes.tensor))
        told = None if self._descriptor is None else self._descriptor.compute(cloud)

        def looks(owner: Int[np.ndarray, ' points'], count: int) -> tuple[Rows, ...]:
            shaped = shapes(cloud, ground.height, owner, count, self._tall)
            return (shaped,) if told is None else (shaped, described(told, owner, count).astype(np.float32))

        return _Looks(looks(point, int(point.max(initial=-1)) + 1), looks(inside, len(boxes)))

    @cached_property
    def _fitted(self) -> _Fitted:
        groups: tuple[list[str], list[str]] = ([], [])
        for scene in self._scene_ids:
            groups[len(self._annotated(scene).boxes) > 0].append(scene)
        chosen = [group[row] for group in groups for row in evenly_spread(len(group), SCENES)]
        looks, labels = [], []
        for scene in tqdm(chosen, desc='what clusters look like', leave=False):
            looks.append(self._looks(scene, segment_ground(self._scenes.get(scene).cloud.xyz)))
            labels.append(self._annotated(scene).boxes.labels)
        for scene, part in zip(chosen, looks, strict=True):
            if part.clusters[0].shape[1] != looks[0].clusters[0].shape[1]:
                raise SceneError(
                    f'{scene}: expected intensity and colours as in {chosen[0]}, since what objects look like is '
                    'compared over all scenes; give all scenes the same, or set predicted_boxes.least_likeness=0'
                )
        clusters, objects = (
            [np.concatenate(kind) for kind in zip(*parts, strict=True)] for parts in zip(*looks, strict=True)
        )
        of = np.concatenate(labels)
        seen = np.asarray(objects[0].any(axis=1), dtype=bool)
        fits = [_fit(own, seen, of, rows, len(self._sizes)) for own, rows in zip(objects, clusters, strict=True)]
        every = seen * np.nan_to_num(known_mean([left_out for _, left_out in fits]))
        parts = np.split(every, np.cumsum([len(part) for part in labels])[:-1])
        return _Fitted(tuple(likeness for likeness, _ in fits), dict(zip(chosen, parts, strict=True)))


def _fit(
    objects: Rows, seen: Bool[np.ndarray, ' objects'], labels: Int[np.ndarray, ' objects'], clusters: Rows, classes: int
) -> tuple[Likeness, Float[np.ndarray, ' objects']]:
    """Likeness by rows of one kind; and that of annotated objects left out, NaN for one that has no such row."""
    told = np.asarray(seen & np.isfinite(objects).all(axis=1), dtype=bool)
    known = clusters[np.isfinite(clusters).all(axis=1)]
    likeness, left_out = fit_likeness(objects[told], labels[told], known, classes)
    out = np.full(len(objects), np.nan)
    out[told] = np.where(likeness.known[labels[told]], left_out, np.nan)
    return likeness, out


def _likeness(fitted: Sequence[Likeness], parts: Sequence[Rows]) -> Float[np.ndarray, '_things classes']:
    return known_mean([likeness.of(part) for likeness, part in zip(fitted, parts, strict=True)])
