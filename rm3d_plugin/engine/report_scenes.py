"""What a segmentation run made of single scenes, gathered for its report."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.engine.base_labeler import BaseLabeler
from rm3d_plugin.evaluation.point_fields import predicted_classes
from rm3d_plugin.structures import UNLABELLED, PointCloud, PseudoLabels
from rm3d_plugin.visualization import BevPanel, Picture, draw_bev
from rm3d_plugin.visualization.bev import class_point_colors
from rm3d_plugin.visualization.palette import class_color, region_colors

CEILING = 'ceiling'  # hides a room seen from above


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
    out = np.full(total, UNLABELLED, dtype=np.int64)
    out[np.arange(len(probabilities)) if index is None else index] = predicted_classes(probabilities)
    return out


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
    out = np.full(total, UNLABELLED, dtype=np.int64)
    out[np.arange(len(rows)) if index is None else index] = rows
    return out


def pick_scenes(labeler: BaseLabeler, count: int) -> list[str]:
    """Training scenes to show: the one with most classes in its labels first; ties by name."""
    names = sorted(labeler.store.scenes())
    richness = {name: len(np.unique(labeler.store.read(name).semantic)) for name in names} if count else {}
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
        panels[-1] = BevPanel(panels[-1].title, xyz, panels[-1].colors, legend=legend)
    return Picture(scene.caption, draw_bev(panels or [BevPanel('Scene', xyz)]))


def _uncovered(
    scene: SceneRecord, classes: Sequence[str], last: Int[np.ndarray, ' points'] | None
) -> Int[np.ndarray, ' kept']:
    """Points that no ceiling hides, from low to high."""
    order = np.argsort(scene.cloud.xyz[:, 2], kind='stable')
    known = next((v for v in (scene.truth, scene.predicted, last) if v is not None), None)
    if known is None or CEILING not in classes:
        return order
    return order[known[order] != list(classes).index(CEILING)]
