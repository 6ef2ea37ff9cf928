"""One scene refreshed, from parts."""

from rm3d_plugin.pseudo_labels import (
    PointPrediction,
    RoundContext,
    SceneInputs,
    SceneKnowledge,
    SegmentationRules,
    refresh_segmentation,
)
from rm3d_plugin.regions import MergeRules
from rm3d_plugin.regions.prepare import PreparedScene


def inputs(scene, annotated=None, rows=None, centers=None, previous=None, cloud=None):
    """Inputs of a scene that has ``cloud``, ``regions``, ``graph`` and ``annotated``."""
    geometry = PreparedScene(scene.cloud if cloud is None else cloud, scene.regions, scene.graph)
    prediction = None if rows is None else PointPrediction(rows, centers)
    return SceneInputs(geometry, scene.annotated if annotated is None else annotated, prediction, previous)


def points(scene_inputs, rules, round, counts, things=(), **knowledge):
    """What a refresh of segmentation makes of it; ``rules`` may be of merging alone."""
    rules = SegmentationRules(rules) if isinstance(rules, MergeRules) else rules
    context = RoundContext(round, rules, counts, things)
    return refresh_segmentation(scene_inputs, context, SceneKnowledge(**knowledge))
