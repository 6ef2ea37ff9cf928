"""Labels that a person gave by clicking on points: CSV or JSON in and out."""

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.label_budgets.audit import AnnotatedPoints
from rm3d_plugin.label_budgets.base import BudgetError, class_counts
from rm3d_plugin.label_budgets.point_amount import PointAmount
from rm3d_plugin.label_budgets.points import PointBudget, RowsOf, SceneSize, checked_budget
from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.storage.files import read_json, write_json, write_text
from rm3d_plugin.structures import PointCloud

TOLERANCE = 0.05  # m between a clicked place and the nearest point
COLUMNS = ('scene', 'index', 'x', 'y', 'z', 'class', 'instance')


@dataclass(frozen=True)
class Click:
    """One labelled point.

    Attributes:
        scene: Name of its scene.
        semantic: Class number.
        instance: Instance number, -1 = none.
        index: Point number in the original file, or None where only the place is known.
        xyz: Place in metres, in the coordinates of the original file, or None where only the number is known.
        where: For error messages, such as ``clicks.csv line 3``.
    """

    scene: str
    semantic: int
    instance: int = -1
    index: int | None = None
    xyz: tuple[float, float, float] | None = None
    where: str = 'click'


def read_clicks(path: str | Path, classes: Sequence[str]) -> list[Click]:
    """Read ``scene,index,class[,instance]`` or ``scene,x,y,z,class[,instance]``.

    A CSV file begins with a line that names its columns, in any order; a JSON file is a list of objects with these
    names. The class is a name or a number of ``classes``. Where both index and place are given, the place must be that
    of the point.

    Raises:
        BudgetError: The file or one of its lines cannot be used; the message names both.
    """
    path = Path(path)
    if not path.is_file():
        raise BudgetError(f'{path}: no such file of clicks')
    rows = _json_rows(path) if path.suffix.lower() == '.json' else _csv_rows(path)
    clicks = [_click(where, row, classes) for where, row in rows]
    if not clicks:
        raise BudgetError(f'{path}: holds no click')
    return clicks


def write_clicks(path: str | Path, clicks: Sequence[Click], classes: Sequence[str]) -> None:
    """Write clicks so that :func:`read_clicks` reads them back: ``.json``, anything else is CSV."""
    path = Path(path)
    rows = [_row(click, classes) for click in clicks]
    if path.suffix.lower() == '.json':
        write_json(path, [{name: value for name, value in row.items() if value != ''} for row in rows])
        return
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator='\n')
    writer.writeheader()
    writer.writerows(rows)
    write_text(path, text.getvalue())


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
        rows_of: For a thinned scene, the row of its cloud that stands for each point of the original file; clicks
            count the points of the original file.

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
        BudgetError: A click is on no point, or contradicts another on the same point.
    """
    found = _point_numbers(clicks, cloud, tolerance, np.arange(len(cloud)) if rows is None else rows)
    labels: dict[int, Click] = {}
    for number, click in zip(found, clicks, strict=True):
        other = labels.setdefault(number, click)
        if (other.semantic, other.instance) != (click.semantic, click.instance):
            raise BudgetError(
                f'{click.where}: point {number} of scene {click.scene} has another label in {other.where}; keep one'
            )
    index = np.asarray(sorted(labels), dtype=np.int64)
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


def _point_numbers(
    clicks: Sequence[Click], cloud: PointCloud, tolerance: float, rows: Int[np.ndarray, ' original']
) -> list[int]:
    places = np.array([click.xyz if click.xyz is not None else (np.nan,) * 3 for click in clicks]).reshape(-1, 3)
    local = places - np.asarray(cloud.origin)
    found, distance = _nearest(cloud.xyz, local)
    for i, click in enumerate(clicks):
        if click.index is not None:
            if not 0 <= click.index < len(rows):
                raise BudgetError(
                    f'{click.where}: scene {click.scene} has the points 0..{len(rows) - 1}, got index {click.index}'
                )
            found[i] = rows[click.index]
            distance[i] = np.linalg.norm(cloud.xyz[found[i]] - local[i])
        if click.xyz is not None and not distance[i] <= tolerance:
            what = 'the nearest point' if click.index is None else f'point {click.index}'
            raise BudgetError(
                f'{click.where}: {what} of scene {click.scene} is {distance[i]:.3g} m from the clicked place, more '
                f'than {tolerance:g} m; give metres in the coordinates of the original file'
            )
    return [int(number) for number in found]


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


def _json_rows(path: Path) -> list[tuple[str, Mapping[str, Any]]]:
    content = read_json(path)
    if not isinstance(content, list) or not all(isinstance(row, dict) for row in content):
        raise BudgetError(f'{path}: expected a list of objects with scene, class and index or x, y, z')
    return [(f'{path} entry {i}', row) for i, row in enumerate(content, start=1)]


def _csv_rows(path: Path) -> list[tuple[str, Mapping[str, Any]]]:
    try:
        text = path.read_text(encoding='utf-8-sig')
    except UnicodeDecodeError as error:
        raise BudgetError(f'{path}: expected UTF-8 text ({error})') from error
    reader = csv.DictReader(io.StringIO(text), skipinitialspace=True)
    names = [name.strip().lower() for name in reader.fieldnames or ()]
    if 'scene' not in names or 'class' not in names or not ('index' in names or {'x', 'y', 'z'} <= set(names)):
        raise BudgetError(
            f'{path}: the first line must name the columns: scene,index,class[,instance] or '
            f'scene,x,y,z,class[,instance]; got {",".join(names)!r}'
        )
    reader.fieldnames = names
    return [(f'{path} line {reader.line_num}', row) for row in reader]


def _click(where: str, row: Mapping[str, Any], classes: Sequence[str]) -> Click:
    cells = {name: '' if row.get(name) is None else str(row[name]).strip() for name in COLUMNS}
    if not cells['scene']:
        raise BudgetError(f'{where}: no scene given')
    place = [cells[name] for name in 'xyz']
    if not cells['index'] and not all(place):
        raise BudgetError(f'{where}: expected an index or x, y and z')
    index = _number(where, 'index', cells['index'], int) if cells['index'] else None
    x, y, z = (
        (_number(where, name, cell, float) for name, cell in zip('xyz', place, strict=True))
        if all(place)
        else (0.0,) * 3
    )
    instance = int(_number(where, 'instance', cells['instance'], int)) if cells['instance'] else -1
    semantic = _class_number(where, cells['class'], classes)
    return Click(
        cells['scene'],
        semantic,
        max(instance, -1),
        None if index is None else int(index),
        (x, y, z) if all(place) else None,
        where,
    )


def _number(where: str, name: str, text: str, kind: type[int] | type[float]) -> float:
    try:
        value = kind(text)
    except ValueError:
        value = float('nan')
    if not np.isfinite(value):
        raise BudgetError(f'{where}: {name}: expected a {"whole " * (kind is int)}number, got {text!r}')
    return value


def _class_number(where: str, text: str, classes: Sequence[str]) -> int:
    if text in classes:
        return list(classes).index(text)
    if text.isdigit() and int(text) < len(classes):
        return int(text)
    raise BudgetError(f'{where}: class: expected one of {", ".join(classes)} or 0..{len(classes) - 1}, got {text!r}')


def _row(click: Click, classes: Sequence[str]) -> dict[str, Any]:
    place = ('', '', '') if click.xyz is None else click.xyz
    return {
        'scene': click.scene,
        'index': '' if click.index is None else click.index,
        **dict(zip('xyz', (value if value == '' else round(float(value), 4) for value in place), strict=True)),
        'class': classes[click.semantic],
        'instance': '' if click.instance < 0 else click.instance,
    }
