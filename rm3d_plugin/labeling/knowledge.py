"""What all scenes of a segmentation run together tell of each: data set statistics, made at first use."""

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from tqdm import tqdm

from rm3d_plugin.labeling.prepared_scenes import PreparedScenes
from rm3d_plugin.ops.segment import segment_values
from rm3d_plugin.pseudo_labels import AnnotatedLabels, RegionPriorRules, SceneInputs, SegmentationRules
from rm3d_plugin.pseudo_labels.ground.classifier import GroundKnowledge, GroundScene, learn_ground
from rm3d_plugin.pseudo_labels.ground.labels import GroundLabels, ground_regions
from rm3d_plugin.pseudo_labels.region_prior.prior import region_prior
from rm3d_plugin.pseudo_labels.region_prior.statistics import RegionStatistics, region_statistics
from rm3d_plugin.regions.prepare import PreparedScene
from rm3d_plugin.structures import UNLABELLED


class DatasetKnowledge:
    """Statistics of the annotated labels and regions of all scenes, as far as the rules ask for them.

    Args:
        scene_ids: All scenes.
        scenes: Their geometry.
        annotated: Gives the annotated labels of a scene that training may know.
        rules: Of the run.
        classes: Number of classes.
    """

    def __init__(
        self,
        scene_ids: Sequence[str],
        scenes: PreparedScenes,
        annotated: Callable[[str], AnnotatedLabels],
        rules: SegmentationRules,
        classes: int,
    ) -> None:
        self._scene_ids, self._scenes, self._annotated = scene_ids, scenes, annotated
        self._rules, self._classes = rules, classes

    @cached_property
    def regions(self) -> RegionStatistics:
        """What the annotated regions of all scenes have in common."""
        rules = self._rules
        scenes = ((self._scenes.get(scene), self._annotated(scene).semantic) for scene in self._scene_ids)
        max_extent = None if rules.propagation is None else rules.propagation.max_extent
        min_upright = None if rules.ground is None else rules.ground.min_upright
        return region_statistics(scenes, self._classes, rules.region_prior, max_extent, min_upright)

    @cached_property
    def ground(self) -> GroundKnowledge | None:
        """What ground looks like, where the rules ask for a classifier and enough is annotated."""
        rules = self._rules.ground
        if rules is None or rules.classifier != 'kernel':
            return None
        return learn_ground(self._ground_scenes, rules.heading)

    def class_lengths(self) -> Float[np.ndarray, ' classes'] | None:
        """Usual length of the regions of each class, metres, where it limits how far labels propagate."""
        rules = self._rules.propagation
        return None if rules is None or rules.max_extent is None else self.regions.lengths

    def region_prior(self, scene: SceneInputs, rules: RegionPriorRules) -> Float[np.ndarray, 'regions classes']:
        """What the regions of a scene may be."""
        statistics, annotated = self.regions, scene.annotated.semantic
        return region_prior(scene.geometry, annotated, statistics.lengths, statistics.known, rules)

    def ground_labels(self, scene: SceneInputs) -> GroundLabels | None:
        """What a classifier says of the ground of a scene; what the first round found stays. None: none is asked."""
        if self.ground is None:
            return None
        ground, previous = self._ground_points(scene.geometry), scene.previous
        if previous is None:
            return self.ground.labels(scene.geometry.cloud, ground, scene.annotated.semantic, self._classes)
        return GroundLabels(np.where(ground, previous.semantic, UNLABELLED), np.where(ground, previous.confidence, 0.0))

    def _ground_points(self, scene: PreparedScene) -> Bool[np.ndarray, ' points']:
        rules = self._rules.ground
        upright = ground_regions(scene.graph, None if rules is None else rules.min_upright)
        return segment_values(upright, scene.regions.labels, False)

    def _ground_scenes(self) -> Iterator[GroundScene]:
        for scene_id in tqdm(self._scene_ids, desc='what the ground looks like', leave=False):
            scene = self._scenes.get(scene_id)
            yield scene.cloud, self._ground_points(scene), self._annotated(scene_id).semantic
