"""Clicks become a budget and back: from points in the original file to points of a scene."""

from collections.abc import Callable, Sequence
from typing import NoReturn

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.label_budgets.audit import AnnotatedPoints
from rm3d_plugin.label_budgets.base import BudgetError, class_counts
from rm3d_plugin.label_budgets.point_amount import PointAmount
from rm3d_plugin.label_budgets.points import PointBudget, RowsOf, SceneSize, checked_budget
from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.storage.clicks import Click
from rm3d_plugin.structures import PointCloud

TOLERANCE = 0.05  # m between a clicked place and the nearest point


def budget_from_clicks(
    scene_ids: Sequence[str],
    cloud_of: Callable[[str], PointCloud],
    clicks: Sequence[Click],
    amount: PointAmount,
    seed: int,
    tolerance: float = TOLERANCE,
    rows_of: RowsOf | None = None,
) -> PointBudget:
    """The budget that shows what was clicked; the truth is not needed.

    Args:
        scene_ids: Names of all scenes; those without a click show nothing.
        cloud_of: The points of a scene; each is asked for once.
        clicks: The labels.
        amount: Kept with the budget; with ``instances`` False the clicked instances are dropped.
        seed: Kept with the budget; of no other effect.
        tolerance: Metres; a place without a point so near is an error.
        rows_of: For a voxel-downsampled scene, the row of its cloud that stands for each point of the original file;
            clicks count the points of the original file.

    Raises:
        BudgetError: A click is of no such scene, on no point, or contradicts another.
    """
    by_scene: dict[str, list[Click]] = {scene: [] for scene in sorted(scene_ids)}
    for click in clicks:
        if click.scene not in by_scene:
            raise BudgetError(
                f'{click.where}: there is no scene {click.scene!r} among {len(by_scene)}: '
                f'{", ".join(list(by_scene)[:5])}{" ..." if len(by_scene) > 5 else ""}'
            )
        by_scene[click.scene].append(click)
    annotated, sizes = {}, {}
    for scene, own in by_scene.items():
        cloud = cloud_of(scene)
        annotated[scene] = resolve_clicks(
            own, cloud, tolerance, amount.instances, None if rows_of is None else rows_of(scene)
        )
        number = np.unique(annotated[scene].instance[annotated[scene].instance >= 0])
        sizes[scene] = SceneSize(len(cloud), len(annotated[scene].points), len(number))
    counts = class_counts([points.semantic for points in annotated.values()])
    return checked_budget(annotated, frozenset(), seed, amount, counts, counts, sizes)


def resolve_clicks(
    clicks: Sequence[Click],
    cloud: PointCloud,
    tolerance: float = TOLERANCE,
    instances: bool = True,
    rows: Int[np.ndarray, ' original'] | None = None,
) -> AnnotatedPoints:
    """The points of one scene that were clicked; see :func:`budget_from_clicks` for the arguments.

    Raises:
        BudgetError: A click is on no point, or contradicts another on the same point. In a log the later counts.
    """
    labels: dict[int, Click] = {}
    for number, click in zip(point_numbers(clicks, cloud, tolerance, rows).tolist(), clicks, strict=True):
        other = labels.setdefault(number, click)
        if click.logged:
            labels[number] = click
        elif (other.semantic, other.instance) != (click.semantic, click.instance):
            raise BudgetError(
                f'{click.where}: point {number} of scene {click.scene} has another label in {other.where}; keep one'
            )
    index = np.asarray(sorted(number for number in labels if labels[number].semantic >= 0), dtype=np.int64)
    semantic = np.asarray([labels[number].semantic for number in index.tolist()], dtype=np.int64)
    instance = np.asarray([labels[number].instance for number in index.tolist()], dtype=np.int64)
    return AnnotatedPoints(index, semantic, instance if instances else np.full_like(instance, -1))


def clicks_of(
    scene: str, annotated: AnnotatedPoints, cloud: PointCloud, rows: Int[np.ndarray, ' original'] | None = None
) -> list[Click]:
    """Annotated points as clicks, with their number in the original file (see :func:`budget_from_clicks`) and place."""
    kept = np.arange(len(cloud)) if rows is None else np.unique(rows, return_index=True)[1]  # a voxel's first point
    world = cloud.xyz[annotated.points].astype(np.float64) + np.asarray(cloud.origin)
    numbers = kept[annotated.points].tolist()
    labels = zip(annotated.semantic.tolist(), annotated.instance.tolist(), strict=True)
    return [
        Click(scene, semantic, instance, number, (x, y, z))
        for number, (semantic, instance), (x, y, z) in zip(numbers, labels, world.tolist(), strict=True)
    ]


def point_numbers(
    clicks: Sequence[Click],
    cloud: PointCloud,
    tolerance: float = TOLERANCE,
    rows: Int[np.ndarray, ' original'] | None = None,
) -> Int[np.ndarray, ' clicks']:
    """The point of one scene that each click is on; see :func:`budget_from_clicks` for the arguments.

    Raises:
        BudgetError: A click is on no point.
    """
    count = len(cloud) if rows is None else len(rows)
    for click in clicks:  # before they become numbers of 64 bits
        if click.index is not None and not 0 <= click.index < count:
            raise BudgetError(
                f'{click.where}: scene {click.scene} has the points 0..{count - 1}, got index {click.index}'
            )
    index = np.array([-1 if click.index is None else click.index for click in clicks], dtype=np.int64)
    by_number = np.array([click.index is not None for click in clicks], dtype=np.bool_)
    found = np.array(index if rows is None else np.where(by_number, rows[index], -1))
    placed = np.flatnonzero([click.xyz is not None for click in clicks])
    if len(placed):
        local = np.array([clicks[i].xyz for i in placed.tolist()]) - np.asarray(cloud.origin)
        nearest, distance = _nearest(cloud.xyz, local)
        found[placed] = np.where(by_number[placed], found[placed], nearest)
        distance = np.where(by_number[placed], np.linalg.norm(cloud.xyz[found[placed]] - local, axis=1), distance)
        for wrong in np.flatnonzero(~(distance <= tolerance))[:1]:
            _raise_far(clicks[int(placed[wrong])], float(distance[wrong]), tolerance)
    return found


def _raise_far(click: Click, distance: float, tolerance: float) -> NoReturn:
    what = 'the nearest point' if click.index is None else f'point {click.index}'
    raise BudgetError(
        f'{click.where}: {what} of scene {click.scene} is {distance:.3g} m from the clicked place, more '
        f'than {tolerance:g} m; give metres in the coordinates of the original file'
    )


def _nearest(
    xyz: Float[np.ndarray, 'points 3'], places: Float[np.ndarray, 'places 3']
) -> tuple[np.ndarray, np.ndarray]:
    """Number and distance of the point nearest to each place, the lowest number on a tie; (-1, inf) for NaN."""
    number, distance = np.full(len(places), -1, dtype=np.int64), np.full(len(places), np.inf)
    known = np.isfinite(places).all(axis=1)
    if known.any() and len(xyz):
        nearest = Octree(xyz).knn(places[known], 1)
        number[known], distance[known] = nearest.indices[:, 0], np.sqrt(nearest.sq_dists[:, 0])
    return number, distance
