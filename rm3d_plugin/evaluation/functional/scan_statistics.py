"""What a labelled indoor scan is like: spacing, noise, edges, colours and object borders.

They tell whether made-up rooms are as hard as real ones, whose values `rm3d_plugin.evaluation.realism` holds.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.evaluation.functional.rank_auc import rank_auc
from rm3d_plugin.ops.color import rgb_to_lab
from rm3d_plugin.ops.octree import Octree

PATCH = 16  # neighbours that a normal and a curvature are taken from
PAIRS = 8  # neighbours that a point is compared with
REACH = 0.05  # m; a point so near to another object lies at a border
CROWD = 32  # nearest points that are looked through for another object
LEAST = 50  # points; smaller objects have no spread of colour


class RoomStatistics(NamedTuple):
    """Statistics of one indoor scan; NaN where the scan has nothing to measure.

    Attributes:
        spacing_cm: Median distance to the nearest point.
        extent_m: The longer side of the ground plan, without the outermost 0.5 percent at each end.
        noise_mm: Median deviation from the plane through 16 neighbours, over the flatter half of the annotated points.
        curvature_p50: Median of l0 / (l0 + l1 + l2) of 17 points.
        curvature_p90: Its ninth decile.
        step_inside_deg: Median angle between the normals of neighbours of one object.
        step_across_deg: The same for neighbours of two objects.
        unannotated_pct: Points without a class.
        pairs_across_pct: Pairs of neighbours that belong to two objects.
        near_border_pct: Annotated points within 5 cm of another object.
        auc_normal: How well that angle tells pairs across a border from pairs inside; 0.5 = not at all.
        auc_curvature: The same for the difference in curvature.
        auc_color: The same for the distance in Lab.
        color_spread: Median over objects of the length of Lab's standard deviations.
        objects: How many there are.
        object_points: Median of their points.
    """

    spacing_cm: float
    extent_m: float
    noise_mm: float
    curvature_p50: float
    curvature_p90: float
    step_inside_deg: float
    step_across_deg: float
    unannotated_pct: float
    pairs_across_pct: float
    near_border_pct: float
    auc_normal: float
    auc_curvature: float
    auc_color: float
    color_spread: float
    objects: float
    object_points: float


class _Shape(NamedTuple):
    """Local planes: (N,) smallest deviation in metres, (N,) curvature, (N, 3) normals."""

    deviation: Float[np.ndarray, ' points']
    curvature: Float[np.ndarray, ' points']
    normals: Float[np.ndarray, 'points 3']


class _Pairs(NamedTuple):
    """Pairs of annotated neighbours, and whether they belong to two objects."""

    a: Int[np.ndarray, ' pairs']
    b: Int[np.ndarray, ' pairs']
    across: Bool[np.ndarray, ' pairs']


def room_statistics(
    xyz: Float[np.ndarray, 'points 3'],
    rgb: Float[np.ndarray, 'points 3'],
    semantic: Int[np.ndarray, ' points'],
    instance: Int[np.ndarray, ' points'],
) -> RoomStatistics:
    """Statistics of an indoor scan; scans are compared at one number of points, 50 thousand as a rule.

    Args:
        xyz: Metres, z up; more than 32 points.
        rgb: In [0, 1].
        semantic: Class, -1 = not annotated.
        instance: Instance, -1 = none; what has none is one object a class.

    Raises:
        ValueError: There are too few points.
    """
    if len(xyz) <= CROWD:
        raise ValueError(f'room_statistics: expected more than {CROWD} points, got {len(xyz)}')
    tree = Octree(xyz)
    nearest = tree.knn(xyz, CROWD)
    shape = _local_shape(xyz, nearest.indices[:, : PATCH + 1])
    owner = _objects(semantic, instance)
    known = owner >= 0
    pairs = _pairs(nearest.indices, owner)
    angle = _angles(shape.normals, pairs)
    bend = np.abs(shape.curvature[pairs.a] - shape.curvature[pairs.b])
    lab = rgb_to_lab(rgb)
    tint = np.linalg.norm(lab[pairs.a] - lab[pairs.b], axis=1)
    border = _near_another(nearest.indices, nearest.sq_dists, owner)
    sizes = np.unique(owner[known], return_counts=True)[1]
    flat = known & (shape.curvature < _median(shape.curvature[known]))
    return RoomStatistics(
        spacing_cm=100 * _median(np.sqrt(nearest.sq_dists[:, 1])),
        extent_m=_extent(xyz),
        noise_mm=1000 * _median(shape.deviation[flat]),
        curvature_p50=_median(shape.curvature),
        curvature_p90=float(np.quantile(shape.curvature, 0.9)),
        step_inside_deg=_median(angle[~pairs.across]),
        step_across_deg=_median(angle[pairs.across]),
        unannotated_pct=100 * float((semantic < 0).mean()),
        pairs_across_pct=100 * _mean(pairs.across),
        near_border_pct=100 * _mean(border[known]),
        auc_normal=rank_auc(angle, pairs.across),
        auc_curvature=rank_auc(bend, pairs.across),
        auc_color=rank_auc(tint, pairs.across),
        color_spread=_color_spread(lab, owner),
        objects=float(len(sizes)),
        object_points=_median(sizes),
    )


def _local_shape(xyz: Float[np.ndarray, 'points 3'], index: Int[np.ndarray, 'points near']) -> _Shape:
    patch = xyz[index] - xyz[index].mean(axis=1, keepdims=True)
    covariance = np.matmul(patch.transpose(0, 2, 1), patch) / index.shape[1]
    values, vectors = np.linalg.eigh(covariance)
    values = np.maximum(values, 0.0)
    total = np.maximum(values.sum(axis=1), 1e-12)
    return _Shape(np.sqrt(values[:, 0]), values[:, 0] / total, vectors[:, :, 0])


def _objects(semantic: Int[np.ndarray, ' points'], instance: Int[np.ndarray, ' points']) -> Int[np.ndarray, ' points']:
    """Number of each point's object: its instance, else its class; -1 where nobody annotated."""
    classes = int(max(semantic.max(), 0)) + 1
    owner = np.where(instance >= 0, instance + classes, semantic)
    return np.where(semantic >= 0, owner, -1)


def _pairs(index: Int[np.ndarray, 'points near'], owner: Int[np.ndarray, ' points']) -> _Pairs:
    a = np.repeat(np.arange(len(owner)), PAIRS)
    b = index[:, 1 : PAIRS + 1].reshape(-1).astype(np.int64)
    known = (owner[a] >= 0) & (owner[b] >= 0)
    a, b = a[known], b[known]
    return _Pairs(a, b, owner[a] != owner[b])


def _angles(normals: Float[np.ndarray, 'points 3'], pairs: _Pairs) -> Float[np.ndarray, ' pairs']:
    """Degrees between normals of either sign."""
    cosine = np.abs((normals[pairs.a] * normals[pairs.b]).sum(axis=1))
    return np.rad2deg(np.arccos(np.minimum(cosine, 1.0)))


def _near_another(
    index: Int[np.ndarray, 'points near'], sq_dists: Float[np.ndarray, 'points near'], owner: Int[np.ndarray, ' points']
) -> Bool[np.ndarray, ' points']:
    """Whether an annotated point of another object lies within REACH."""
    other = owner[index]
    return ((other >= 0) & (other != owner[:, None]) & (sq_dists < REACH**2)).any(axis=1)


def _extent(xyz: Float[np.ndarray, 'points 3']) -> float:
    low, high = np.quantile(xyz[:, :2], [0.005, 0.995], axis=0)
    return float((high - low).max())


def _color_spread(lab: Float[np.ndarray, 'points 3'], owner: Int[np.ndarray, ' points']) -> float:
    numbers, counts = np.unique(owner[owner >= 0], return_counts=True)
    spreads = [np.linalg.norm(lab[owner == number].std(axis=0)) for number in numbers[counts > LEAST]]
    return _median(np.array(spreads))


def _median(values: np.ndarray) -> float:
    return float(np.median(values)) if len(values) else float('nan')


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else float('nan')
