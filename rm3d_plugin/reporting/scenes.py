"""What a segmentation run made of single scenes, gathered for its report."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.evaluation.point_fields import predicted_classes
from rm3d_plugin.labeling.label_maker import LabelMaker
from rm3d_plugin.ops.segment import scatter_rows
from rm3d_plugin.structures import UNLABELLED, PointCloud, PseudoLabels
from rm3d_plugin.visualization import BevPanel, Picture, draw_bev
from rm3d_plugin.visualization.bev import class_point_colors, span_of
from rm3d_plugin.visualization.palette import class_color, region_colors
from rm3d_plugin.visualization.scene_view import Kind, Layer, SceneView, pack_views

CEILING = 'ceiling'  # hides a room seen from above
CUT = 0.85  # share of the height that a view of rooms with ceilings shows at first


@dataclass(frozen=True, eq=False)
class SceneRecord:
    """One scene with all that is known of its points; what is None is not shown.

    Attributes:
        caption: Words for the scene.
        cloud: Its points.
        regions: (N,) region, -1 = discarded.
        labels: Labels that training saw, by round.
        predicted: (N,) class, -1 = not seen by the network.
        instances: (N,) number of the predicted instance, -1 = none.
        truth: (N,) true class, -1 = not known.
        true_instances: (N,) true instance, -1 = none.
    """

    caption: str
    cloud: PointCloud
    regions: Int[np.ndarray, ' points'] | None = None
    labels: Mapping[int, PseudoLabels] = field(default_factory=dict)
    predicted: Int[np.ndarray, ' points'] | None = None
    instances: Int[np.ndarray, ' points'] | None = None
    truth: Int[np.ndarray, ' points'] | None = None
    true_instances: Int[np.ndarray, ' points'] | None = None


def point_classes(
    probabilities: Float[np.ndarray, 'rows classes'], index: Int[np.ndarray, ' rows'] | None, total: int
) -> Int[np.ndarray, ' points']:
    """Most likely class of every point of a scene; -1 where the network saw none.

    Args:
        probabilities: Of the rows that the network saw.
        index: Point of each row; None: row by row.
        total: Points of the scene.
    """
    rows = np.arange(len(probabilities)) if index is None else index
    return scatter_rows(predicted_classes(probabilities), rows, total, UNLABELLED)


def point_instances(
    masks: np.ndarray, scores: Float[np.ndarray, ' found'], index: Int[np.ndarray, ' rows'] | None, total: int
) -> Int[np.ndarray, ' points']:
    """Number of the surest predicted instance that holds each point; -1 = none.

    Args:
        masks: (K, n) bool.
        scores: (K,).
        index: Point of each of the n columns; None: column by column.
        total: Points of the scene.
    """
    rows = np.full(masks.shape[1], UNLABELLED, dtype=np.int64)
    for number in np.argsort(scores, kind='stable'):  # the surest last, on top
        rows[masks[number]] = number
    return scatter_rows(rows, np.arange(len(rows)) if index is None else index, total, UNLABELLED)


def pick_scenes(label_maker: LabelMaker, count: int) -> list[str]:
    """Training scenes to show: the one with most classes in its labels first; ties by name."""
    names = sorted(label_maker.store.scenes())
    richness = {name: len(np.unique(label_maker.store.read(name).semantic)) for name in names} if count else {}
    return sorted(names, key=lambda name: (-richness.get(name, 0), name))[:count]


def scene_from_above(scene: SceneRecord, classes: Sequence[str]) -> Picture:
    """Regions, last labels, prediction, truth and errors from above, the highest points on top, without ceilings."""
    last = scene.labels[max(scene.labels)].semantic if scene.labels else None
    rows = _uncovered(scene, classes, last)
    xyz = scene.cloud.xyz[rows]
    panels = []
    if scene.regions is not None:
        number = len(np.unique(scene.regions[scene.regions >= 0]))
        panels.append(BevPanel(f'{number} regions', xyz, region_colors(scene.regions[rows])))
    named = (('Pseudo labels', last), ('Predictions', scene.predicted), ('Truth', scene.truth))
    for title, values in named:
        if values is not None:
            panels.append(BevPanel(title, xyz, class_point_colors(values[rows], len(classes))))
    shown = [values for _, values in named if values is not None]
    if panels and shown:
        numbers = np.unique(np.concatenate([values[rows] for values in shown]))
        legend = [(class_color(c), classes[c]) for c in numbers.tolist() if 0 <= c < len(classes)]
        panels[-1] = BevPanel(panels[-1].title, xyz, panels[-1].colors, legend=legend, legend_beside=True)
    panels = panels or [BevPanel('Scene', xyz)]
    return Picture(scene.caption, draw_bev(panels, span_of(panels, margin=0.3), dpi=90))


def _uncovered(
    scene: SceneRecord, classes: Sequence[str], last: Int[np.ndarray, ' points'] | None
) -> Int[np.ndarray, ' kept']:
    """Points that no ceiling hides, from low to high."""
    order = np.argsort(scene.cloud.xyz[:, 2], kind='stable')
    known = next((v for v in (scene.truth, scene.predicted, last) if v is not None), None)
    if known is None or CEILING not in classes:
        return order
    return order[known[order] != list(classes).index(CEILING)]


def scene_view(scene: SceneRecord) -> SceneView:
    """The scene with every colouring there is: own colours, regions, labels by round, prediction, truth, instances."""
    labels = [Layer(f'labels {n}', 'class', made.semantic, 'labels') for n, made in sorted(scene.labels.items())]
    layers = [
        Layer('colour', 'rgb', own_colors(scene.cloud)),
        *_layer('regions', 'number', scene.regions),
        *labels,
        *_layer('prediction', 'class', scene.predicted, 'prediction'),
        *_layer('truth', 'class', scene.truth, 'truth'),
        *_layer('found instances', 'number', scene.instances),
        *_layer('true instances', 'number', scene.true_instances),
    ]
    last = scene.labels[max(scene.labels)] if scene.labels else None
    marked = None if last is None or last.complete else np.flatnonzero(last.point_is_annotated)
    return SceneView(scene.caption, scene.cloud.xyz, layers, marked)


def _layer(
    name: str, kind: Kind, values: Int[np.ndarray, ' points'] | None, role: Literal['', 'prediction', 'truth'] = ''
) -> list[Layer]:
    return [] if values is None else [Layer(name, kind, values, role)]


def own_colors(cloud: PointCloud) -> Float[np.ndarray, 'points 3']:
    """Colours of the scan in [0, 1]; else grey by intensity, else by height, from dark to light."""
    if cloud.colors is not None:
        return cloud.colors
    values = cloud.xyz[:, 2] if cloud.intensity is None else cloud.intensity
    low, high = np.quantile(values, (0.02, 0.98)) if len(values) else (0.0, 1.0)
    level = np.clip((values - low) / max(float(high - low), 1e-6), 0, 1)
    return np.repeat(0.25 + 0.7 * level[:, None], 3, axis=1)


def views_of(scenes: Sequence[SceneRecord], classes: Sequence[str]) -> dict[str, Any] | None:
    """All scenes to turn, packed for the page; None without any."""
    if not scenes:
        return None
    return pack_views([scene_view(scene) for scene in scenes], classes, cut=CUT if CEILING in classes else 1.0)
