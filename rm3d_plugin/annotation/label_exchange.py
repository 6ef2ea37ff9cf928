"""Labels of a session for other programs, and back."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rm3d_plugin.annotation.click_log import Action
from rm3d_plugin.class_names import class_index
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.inference.given_labels import MOST_CLASSES, field_values
from rm3d_plugin.inference.label_files import SUMMARY
from rm3d_plugin.label_budgets.clicks import point_numbers, resolve_clicks
from rm3d_plugin.storage import Click, ClickFileError, content_of, read_clicks, read_json, write_clicks
from rm3d_plugin.structures import SceneError

if TYPE_CHECKING:
    from rm3d_plugin.annotation.session import Session


def import_clicks(session: 'Session', path: Path) -> int:
    """See :meth:`~rm3d_plugin.annotation.session.Session.import_clicks`."""
    clicks = read_clicks(path, session.classes)
    unknown = sorted({click.scene for click in clicks} - set(session.scans))
    if unknown:
        raise ClickFileError(f'{path}: scene {unknown[0]!r} is none of the scans: {", ".join(session.scans)}')
    groups: dict[tuple[str, int, int], list[Click]] = {}
    for scene in dict.fromkeys(click.scene for click in clicks):
        own = [click for click in clicks if click.scene == scene]
        found = resolve_clicks(own, session.scan(scene).cloud)
        for point, semantic, instance in zip(*(each.tolist() for each in found), strict=True):
            same = groups.setdefault((scene, semantic, instance), [])
            same.append(Click(scene, semantic, instance, index=point))
    session.act(Action(list(groups.values())))
    return sum(map(len, groups.values()))


def export_clicks(session: 'Session', path: Path) -> Path:
    """See :meth:`~rm3d_plugin.annotation.session.Session.export_clicks`."""
    write_clicks(path, [click for scan in session.scans for click in _placed(session, scan)], session.classes)
    return path


def _placed(session: 'Session', scan: str) -> list[Click]:
    """The clicks that stand in a scan, each with number and place."""
    actions = session.log.actions(scan)
    if not actions:
        return []
    cloud = session.scan(scan).cloud
    last = dict(zip(point_numbers(actions, cloud).tolist(), actions, strict=True))
    standing = {point: click for point, click in last.items() if click.semantic >= 0}
    places = (cloud.xyz[list(standing)].astype(np.float64) + np.asarray(cloud.origin)).tolist()
    return [
        Click(scan, click.semantic, click.instance, point, (x, y, z))
        for (point, click), (x, y, z) in zip(standing.items(), places, strict=True)
    ]


def import_labels(session: 'Session', scan: str, path: Path, field: str) -> int:
    """Take over the labels in a field of a file that has the points of a scan in the same order, one action.

    A value is the class that ``labels.json`` beside the file names; without one, a class that is named as the value.
    Classes that are not there are added.

    Args:
        session: That is labelled.
        scan: Name of the scan.
        path: PLY, PCD, LAS, or another format that is read; it may be the scan itself.
        field: See :func:`~rm3d_plugin.inference.given_labels.field_labels`, where is said which values are no label.

    Returns:
        Points that were labelled.

    Raises:
        ConfigError: There is no such field, or it holds no label.
        SceneError: The file cannot be read, holds another number of points, or no whole numbers.
    """
    has_place = session.scan(scan).has_place
    values = field_values(field, path, session.columns)
    if len(values) != len(has_place):
        raise SceneError(f'{path}: expected the {len(has_place)} points of scan {scan}, got {len(values)}')
    values = values[has_place]
    points = np.flatnonzero(values >= 0)
    if not len(points):
        raise ConfigError(f'{path}: field {field!r} labels no point')
    found, place = np.unique(values[points], return_inverse=True)
    names, numbers = _names(path.parent / SUMMARY), []
    fresh = {names.get(value, str(value)) for value in found.tolist()} - set(session.classes)
    if len(fresh) + len(session.classes) > MOST_CLASSES:
        raise ConfigError(
            f'{path}: field {field!r} would make {len(fresh)} classes; expected {MOST_CLASSES} in all at most: does it '
            'hold labels?'
        )
    for value in found.tolist():
        name = names.get(value, str(value))
        number = class_index(name, session.classes)
        numbers.append(session.add_class(name) if number is None else number)
    session.give(scan, points, np.array(numbers)[place])
    return len(points)


def _names(path: Path) -> dict[int, str]:
    """Names of values, where a summary beside the labels tells them."""
    if not path.is_file():
        return {}
    with content_of(path, 'the names of labels'):
        return {int(each['label']): str(each['name']) for each in read_json(path)['classes']}
