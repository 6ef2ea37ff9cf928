"""The few labels that somebody gave for scans: clicks in a file, or a field of the scans themselves."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.label_budgets.clicks import resolve_clicks
from rm3d_plugin.storage import Click, click_classes, read_clicks
from rm3d_plugin.storage.columns import read_columns
from rm3d_plugin.storage.scans import read_cloud
from rm3d_plugin.structures import UNLABELLED, SceneError

MOST_CLASSES = 1000  # time and memory grow with them
LAS_UNLABELLED = (0, 1)  # LAS classification: never classified; looked at, no class
MOST = 2**31 - 1  # a label is written as a number of 32 bits
EXAMPLES = 5  # names that an error lists


class PointLabels(NamedTuple):
    """Labelled points of one scan: their numbers in the file, ascending, and the class of each."""

    points: Int[np.ndarray, ' labelled']
    semantic: Int[np.ndarray, ' labelled']

    def on_points(self, count: int) -> Int[np.ndarray, ' points']:
        """Class of each point of the scan, -1 = unlabelled."""
        out = np.full(count, UNLABELLED, dtype=np.int64)
        out[self.points] = self.semantic
        return out


class GivenLabels(NamedTuple):
    """Labels of several scans.

    Attributes:
        names: Of the classes.
        values: Number that stands for each class in files.
        scans: Name of a scan, without ending -> its labels.
    """

    names: tuple[str, ...]
    values: tuple[int, ...]
    scans: Mapping[str, PointLabels]


def clicked_labels(path: Path, scans: Sequence[Path], columns: str | None = None) -> GivenLabels:
    """The labels of a file of clicks; classes are the names in it, sorted.

    Args:
        path: See :func:`rm3d_plugin.storage.read_clicks`.
        scans: Files, each of another name.
        columns: See :func:`rm3d_plugin.storage.scans.read_scan`.

    Raises:
        ClickFileError, BudgetError: The file cannot be used, or a click is on no point of its scan.
        ConfigError: It names a scan that is not there, or labels points of fewer than two classes or absurdly many.
        SceneError: A scan cannot be read.
    """
    names = click_classes(path)
    by_scan: dict[str, list[Click]] = {scan.stem: [] for scan in scans}
    for click in read_clicks(path, names):
        if click.scene not in by_scan:
            known = ', '.join(list(by_scan)[:EXAMPLES]) + (' ...' if len(by_scan) > EXAMPLES else '')
            raise ConfigError(
                f'{click.where}: scene {click.scene!r} is none of the scans: {known}; the column scene holds the '
                'name of a scan without its ending: mend it, or name that scan, too'
            )
        by_scan[click.scene].append(click)
    _check_classes(
        scans, f'{path}', {click.semantic for clicks in by_scan.values() for click in clicks if click.semantic >= 0}
    )
    found: dict[str, PointLabels] = {}
    for scan in scans:
        annotated = resolve_clicks(by_scan[scan.stem], read_cloud(scan, columns), instances=False)
        found[scan.stem] = PointLabels(annotated.points, annotated.semantic)
    return GivenLabels(tuple(names), tuple(range(len(names))), found)


def field_labels(
    field: str, scans: Sequence[Path], columns: str | None = None, unlabelled: Sequence[int] = ()
) -> GivenLabels:
    """The labels in a field of the scans; classes are the numbers found there.

    Args:
        field: Name of the column, property or dimension; case does not matter, and ``scalar_`` before it is passed
            over, as CloudCompare writes it.
        scans: Files, each of another name.
        columns: See :func:`rm3d_plugin.storage.scans.read_scan`.
        unlabelled: Values that say nothing, beside NaN, negative ones, and 0 and 1 of LAS's ``classification``.

    Raises:
        ConfigError: A scan has no such field, or all together have labels of fewer than two classes there, or of
            more than are possible.
        SceneError: A scan cannot be read, or the field holds no whole numbers.
    """
    raw: dict[str, Int[np.ndarray, ' points']] = {}
    for scan in scans:
        raw[scan.stem] = field_values(field, scan, columns, unlabelled)
    every = np.unique(np.concatenate([values[values >= 0] for values in raw.values()]))
    _check_classes(scans, f'field {field!r}', set(every.tolist()))
    found = {}
    for name, values in raw.items():
        points = np.flatnonzero(values >= 0)
        found[name] = PointLabels(points, np.searchsorted(every, values[points]))
    return GivenLabels(tuple(map(str, every.tolist())), tuple(every.tolist()), found)


def _check_classes(scans: Sequence[Path], where: str, classes: set[int]) -> None:
    if len(classes) < 2:
        names = ', '.join(scan.name for scan in scans[:EXAMPLES]) + (' ...' if len(scans) > EXAMPLES else '')
        raise ConfigError(
            f'{where}: labels points of {len(classes)} {"class" if len(classes) == 1 else "classes"} of {names}; '
            'expected at least two: label a point of each class'
        )
    if len(classes) > MOST_CLASSES:
        raise ConfigError(
            f'{where}: {len(classes)} classes; expected at most {MOST_CLASSES}: are these numbers of points?'
        )


def field_values(
    field: str, scan: Path, columns: str | None = None, unlabelled: Sequence[int] = ()
) -> Int[np.ndarray, ' points']:
    """The values of a field of a scan; -1 where they say nothing. Arguments and errors: :func:`field_labels`."""
    if scan.suffix.lower() in ('.las', '.laz') and field.lower() == 'classification':
        unlabelled = (*unlabelled, *LAS_UNLABELLED)
    table = read_columns(scan, columns)
    found = [name for name in table if field in (name, name.lower(), name.lower().removeprefix('scalar_'))]
    if not found:
        raise ConfigError(f'{scan}: no field {field!r}, got {" ".join(table)}; name one of these')
    values = np.asarray(table[field if field in found else found[0]])
    if values.dtype.kind == 'f':
        values = np.where(np.isnan(values), UNLABELLED, values)
        wrong = ~np.isfinite(values) | (np.floor(values) != values)
        if wrong.any():
            raise SceneError(f'{scan}: {field}: expected whole numbers, got {values[wrong][0]}; NaN or -1 = unlabelled')
    if len(values) and values.max() > MOST:
        raise SceneError(f'{scan}: {field}: expected numbers up to {MOST}, got {values.max()}')
    whole = values.astype(np.int64)
    return np.where((whole < 0) | np.isin(whole, list(unlabelled)), UNLABELLED, whole)
