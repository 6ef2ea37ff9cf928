"""Keys that a config leaves to the data: classes, sizes, ranges, and the lengths that follow from them."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from mmengine.config import Config

from rm3d_plugin.engine.config_errors import config_errors
from rm3d_plugin.engine.run import label_hooks
from rm3d_plugin.labeling.sources import LabelSource
from rm3d_plugin.pseudo_labels.detection.boxes import median_sizes
from rm3d_plugin.registry import TASK_UTILS
from rm3d_plugin.structures import Boxes3D, PointCloud, SceneError, stray_points

MOST_SCENES = 60  # clouds that the range is measured on, spread over the training scenes
VOXELS_ACROSS = 10  # voxels across the narrowest class: 16 cm for cars, 6 cm for people
COARSEST, FINEST = 0.4, 0.02  # m; larger voxels blur the shapes that regions tell apart, smaller ones cost memory
USUAL = (0.4, 6.0)  # m; how far objects stretch (see `stretch`) that the settings are made for
CAR = 2.5  # m; how far a car does
STRAIGHT = 1e-3  # radians
LEAST_NEAR = 0.3  # m; votes for small things scatter, too
OBJECT_GAMMA, NEVER = 0.4, 1.1  # see configs/_base_/kitti.py: classes, background


class Measured(NamedTuple):
    """What the data say.

    Attributes:
        options: Values of the keys that the config leaves None.
        lines: The same for people.
    """

    options: dict[str, Any]
    lines: list[str]


def measure_boxes(config: Config) -> Measured:
    """Fill what a detection config leaves None: lengths from its training scenes and annotated boxes, from no others.

    Args:
        config: Resolved, with ``measured = 'boxes'``.

    Raises:
        SceneError: The data cannot be used, or no class is found.
    """
    (hook,) = label_hooks(config, 'there is no budget of boxes')
    with config_errors(config):
        source: LabelSource = TASK_UTILS.build(hook.label_maker.source)
    if not source.classes:
        raise SceneError(f'{config.data_root}: no class is found, as no file of boxes holds any; label a few objects')
    boxes = [source.annotated_labels(index).boxes for index in range(len(source.scene_ids))]
    shown = Boxes3D(np.concatenate([b.tensor for b in boxes]), np.concatenate([b.labels for b in boxes]))
    sizes = class_sizes(shown, source.classes)
    unit = unit_of(sizes) if config.get('unit') is None else 1.0  # the source has divided by a given one
    space = point_space(source, unit)
    found = {'classes': list(source.classes), 'num_classes': len(source.classes), 'unit': unit}
    found |= {'class_sizes': _plain(sizes / unit), 'point_range': space.limits, 'heights': space.heights}
    found |= lengths_of(sizes / unit) | turns_of(shown)
    open_keys = {key: value for key, value in found.items() if key in config and config[key] is None}
    return Measured(open_keys, list(_lines(source, shown, open_keys)))


def class_sizes(boxes: Boxes3D, classes: Sequence[str]) -> Float[np.ndarray, 'classes 3']:
    """Median size of the annotated boxes of each class, metres; the median of all for a class without any."""
    sizes = median_sizes(boxes.tensor, boxes.labels, len(classes))
    return np.where(np.isfinite(sizes), sizes, np.median(boxes.tensor[:, 3:6], axis=0))


def stretch(sizes: Float[np.ndarray, 'classes 3']) -> Float[np.ndarray, ' classes']:
    """How far each class stretches from above: the geometric mean of length and width, metres."""
    return np.sqrt(sizes[:, 0] * sizes[:, 1])


def unit_of(sizes: Float[np.ndarray, 'classes 3']) -> float:
    """Metres that count as one: 1 for objects of usual size, else so many that they stretch as far as cars.

    Losses and settings are in metres, and fit things from chairs to lorries.

    >>> unit_of(np.array([[3.9, 1.6, 1.5], [0.8, 0.6, 1.7]])), unit_of(np.array([[36.0, 9.0, 15.0]]))
    (1.0, 7.2)
    """
    usual = float(np.exp(np.log(stretch(sizes)).mean()))
    return 1.0 if USUAL[0] <= usual <= USUAL[1] else float(f'{usual / CAR:.2g}')


def lengths_of(sizes: Float[np.ndarray, 'classes 3']) -> dict[str, Any]:
    """Lengths that follow from the sizes of the classes, metres, in the proportions of configs/_base_/kitti.py.

    Args:
        sizes: (C, 3) metres.

    Returns:
        By class, from how far it stretches: ``near``, ``far`` and ``centre_distance``; from the farthest ``radius``;
        from the narrowest side ``voxel_size``, and in voxels what describes and joins points.
    """
    near = np.maximum(0.32 * stretch(sizes), LEAST_NEAR)
    voxel = float(np.clip(sizes[:, :2].min() / VOXELS_ACROSS, FINEST, COARSEST))
    return {
        'near': _plain(near),
        'far': _plain(2 * near),
        'radius': round(1.5 * float(near.max()), 3),
        'voxel_size': round(voxel, 3),
        'descriptor_radius': round(3 * voxel, 3),
        'max_edge': round(2 * voxel, 3),
        'max_gap': round(6 * voxel, 3),
        'centre_distance': [*_plain(1.5 * near), None],
        'class_gamma': [*[OBJECT_GAMMA] * len(sizes), NEVER],
    }


def turns_of(boxes: Boxes3D) -> dict[str, Any]:
    """Whether boxes turn: where no annotated one does, headings are not learnt and scans are not turned."""
    if (np.abs(boxes.tensor[:, 6]) < STRAIGHT).all():
        return {'heading_bins': 1, 'box_kind': 'axis_aligned', 'train_pipeline': '${aligned_pipeline}'}
    return {'heading_bins': 12, 'box_kind': 'completed', 'train_pipeline': '${turning_pipeline}'}


class Space(NamedTuple):
    """Where the points of the training scenes are.

    Attributes:
        limits: (x, y, z, x, y, z) metres that hold all of them but strays; None where scans lie far from zero, each in
            a frame of its own.
        heights: Lowest and highest usual z, metres.
    """

    limits: list[float] | None
    heights: list[float]


def point_space(source: LabelSource, unit: float = 1.0) -> Space:
    """The range of some training scenes, in units of so many metres."""
    count = len(source.scene_ids)
    clouds = [source.load_cloud(i) for i in np.linspace(0, count - 1, min(count, MOST_SCENES)).astype(int).tolist()]
    low, high = np.min([_ends(c)[0] for c in clouds], axis=0), np.max([_ends(c)[1] for c in clouds], axis=0)
    heights = np.median([np.quantile(cloud.xyz[:, 2], (0.01, 0.99)) for cloud in clouds], axis=0)
    heights[1] = max(heights[1], heights[0] + 0.1)  # m; a flat scan has a height, too
    own_frames = any(np.any(cloud.origin) for cloud in clouds)
    limits = None if own_frames else [*np.floor(low / unit).tolist(), *(np.floor(high / unit) + 1).tolist()]
    return Space(limits, _plain(heights / unit))


def _ends(cloud: PointCloud) -> tuple[np.ndarray, np.ndarray]:
    xyz = cloud.xyz[~stray_points(cloud.xyz.astype(np.float64))]
    return xyz.min(axis=0), xyz.max(axis=0)


def _plain(values: np.ndarray) -> list[Any]:
    rounded: list[Any] = np.round(np.asarray(values, dtype=np.float64), 3).tolist()
    return rounded


def _lines(source: LabelSource, shown: Boxes3D, found: Mapping[str, Any]) -> Iterator[str]:
    yield f'Found in the data (each is a key of --cfg-options): {source.describe().splitlines()[0]}'
    counts = np.bincount(shown.labels, minlength=len(source.classes))
    unit = found.get('unit', 1.0)
    for number, name in enumerate(source.classes):
        size = [f'{unit * v:.3g}' for v in found['class_sizes'][number]] if 'class_sizes' in found else []
        told = f', median {" x ".join(size)} m' if size else ''
        yield f'  class {name}: {counts[number]} annotated boxes{told}' + ' (of all classes)' * (not counts[number])
    for key, value in found.items():
        if key not in ('classes', 'class_sizes', 'num_classes'):
            yield f'  {key} = {value}'
