"""A person labels scans: clicks in, labels out; every action is on the disk when it is answered."""

import contextlib
from collections.abc import Iterable, Sequence
from operator import index
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.annotation.annotated_scan import AnnotatedScan
from rm3d_plugin.annotation.click_log import Action, ClickLog, default_log
from rm3d_plugin.annotation.label_check import contradicted
from rm3d_plugin.annotation.label_exchange import export_clicks, import_clicks, import_labels
from rm3d_plugin.annotation.objects import Objects
from rm3d_plugin.annotation.suggestions import Suggestion
from rm3d_plugin.class_names import class_index
from rm3d_plugin.inference.given_labels import GivenLabels, PointLabels
from rm3d_plugin.inference.label_files import (
    SAME,
    LabelOptions,
    Summary,
    WrittenScan,
    check_outputs,
    summary_of,
    write_scan,
)
from rm3d_plugin.inference.label_scan import LabelledScan
from rm3d_plugin.inference.predict import check_names
from rm3d_plugin.inference.scan_kind import scan_kind
from rm3d_plugin.label_budgets.clicks import point_numbers
from rm3d_plugin.storage import Click, ClickFileError
from rm3d_plugin.storage.click_log_lines import class_row
from rm3d_plugin.storage.locks import process_lock
from rm3d_plugin.structures import UNLABELLED, PointCloud, SceneError
from rm3d_plugin.visualization.palette import class_color

NO_CLASS = 'a click needs a class: add one first'


class Session:
    """Scans that are labelled together; one process at a time.

    Attributes:
        log: What was done.
        columns: What the columns of tables hold.
        objects: Clicks that belong together, and their boxes.

    Args:
        scans: Files that can be read, each of another name.
        log: The ``.jsonl`` file of the clicks; a session that is there is taken up. None: ``NAME.clicks.jsonl`` beside
            the only scan, ``clicks.jsonl`` beside the first of several.
        classes: Names of classes that are there from the start; one that was given another name since is there.
        columns: What the columns of tables hold, see :func:`rm3d_plugin.storage.scans.read_scan`.
        drop_nan: Pass over points whose place is NaN; numbers of points count the others, and labels of a saved scan
            are -1 there. Else such a scan is refused.

    Raises:
        ConfigError: Two scans have one name.
        ClickFileError: The log cannot be used, or holds clicks of another scan.
        FolderInUseError: Another session writes the log.
        SceneError: There is no scan, or one of them is no file.
    """

    def __init__(
        self,
        scans: Sequence[Path],
        log: Path | None = None,
        classes: Sequence[str] = (),
        columns: str | None = None,
        drop_nan: bool = False,
    ) -> None:
        if not scans:
            raise SceneError('a session needs a scan, got none')
        check_names(scans, [scan.stem for scan in scans])
        for scan in scans:
            if not Path(scan).is_file():
                raise SceneError(f'{scan}: no such file')
        self._paths = {scan.stem: Path(scan) for scan in scans}
        self.columns, self._drop_nan, self._open = columns, drop_nan, dict[str, AnnotatedScan]()
        path = log or default_log(scans)
        for name in classes:
            class_row(name, None, path)
        self._lock = contextlib.ExitStack()
        self._lock.enter_context(process_lock(path.with_name(path.name + '.lock')))
        try:
            self.log = ClickLog(path)
            self._check_scenes()
            known = [*self.log.classes, *self.log.renamed]  # a class that has another name now is there
            for name in classes:
                if class_index(name, known) is None:
                    self.add_class(name)
        except BaseException:
            self.close()
            raise
        self.objects = Objects(self)
        self._done: list[list[int]] = self.log.standing
        self._undone: list[Action] = []

    def close(self) -> None:
        """Let other sessions write the log; nothing is left to be saved."""
        self._lock.close()

    def __enter__(self) -> 'Session':
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    # ------------------------------------------------------------------ scans and classes

    @property
    def scans(self) -> list[str]:
        """Names of the scans."""
        return list(self._paths)

    def path(self, name: str) -> Path:
        """The file of a scan."""
        return self._paths[name]

    def scan(self, name: str) -> AnnotatedScan:
        """A scan, read at first use.

        Raises:
            SceneError: There is no such scan, or it cannot be read.
            BudgetError: A click of the log is on no point of it.
        """
        if name not in self._paths:
            raise SceneError(f'no scan {name!r} in this session; it has {", ".join(self._paths)}')
        if name not in self._open:
            scan = AnnotatedScan(self._paths[name], self.columns, self._drop_nan)
            self._follow(name, scan)
            self._open[name] = scan
        return self._open[name]

    @property
    def classes(self) -> tuple[str, ...]:
        """Names of the classes; a class keeps its number."""
        return self.log.classes

    def class_number(self, name: str) -> int:
        """Number of a class, letter case aside.

        Raises:
            ClickFileError: There is no such class.
        """
        number = class_index(name, self.classes)
        if number is None:
            known = ', '.join(self.classes)
            raise ClickFileError(f'no class {name!r} in this session; {f"it has {known}" if known else NO_CLASS}')
        return number

    def color(self, name: str) -> str:
        """Colour of a class as ``#rrggbb``: its own, or one by its number."""
        return self.log.colors.get(name) or class_color(self.classes.index(name))

    def add_class(self, name: str, color: str | None = None) -> int:
        """Name a class, or give it another colour; returns its number.

        Raises:
            ClickFileError: The name is empty.
        """
        return self.log.add_class(name, color)

    def rename_class(self, old: str, new: str) -> None:
        """Give a class another name.

        Raises:
            ClickFileError: There is no such class, or the new name is taken.
        """
        self.log.rename_class(old, new)

    # ------------------------------------------------------------------ actions

    def click(self, scan: str, point: int, name: str, instance: int = -1) -> None:
        """Label a point, whatever it was labelled before.

        Args:
            scan: Name of the scan.
            point: Number in its file.
            name: Of the class.
            instance: Number of the object, -1 = none.

        Raises:
            SceneError: There is no such scan or point.
            ClickFileError: There is no such class, or the line cannot be written.
        """
        self.brush(scan, [point], name, instance)

    def region(self, scan: str, point: int, name: str, instance: int = -1) -> None:
        """Label the whole region that a point lies in; see :meth:`click`."""
        self._checked_points(scan, [point])
        region = self.scan(scan).region
        self.brush(scan, np.flatnonzero(region == region[point]).tolist(), name, instance)

    def brush(self, scan: str, points: Iterable[int], name: str, instance: int = -1) -> None:
        """Label many points at once, one action; see :meth:`click`."""
        number, numbers = self.class_number(name), self._checked_points(scan, points)
        self.act(Action([[Click(scan, number, instance, index=point) for point in numbers]]))

    def give(self, scan: str, points: Int[np.ndarray, ' given'], classes: Int[np.ndarray, ' given']) -> None:
        """Label points with a class each, one action.

        Args:
            scan: Name of the scan.
            points: Numbers in its file, each once.
            classes: Number of the class of each.

        Raises:
            SceneError: There is no such scan or point, or no point at all.
            ClickFileError: There is no such class, or the lines cannot be written.
        """
        self._checked_points(scan, points)
        found = np.unique(classes).tolist()
        groups = [[Click(scan, each, index=point) for point in points[classes == each].tolist()] for each in found]
        self.act(Action(groups))

    def erase(self, scan: str, points: Iterable[int]) -> None:
        """Take the labels of points away, one action; points without a label stay so."""
        numbers = self._checked_points(scan, points)
        self.act(Action([[Click(scan, UNLABELLED, index=point) for point in numbers]]))

    def act(self, action: Action) -> None:
        """Keep an action of several clicks and boxes, whose points and classes are there; :meth:`undo` takes it back.

        Raises:
            ClickFileError: The lines cannot be written.
        """
        self._add(action)
        self._undone = []

    def undo(self) -> bool:
        """Take the latest action back; False where there is none."""
        if not self._done:
            return False
        taken = self.log.take_back(self._done[-1])
        self._done.pop()
        self._undone.append(taken)
        for name in taken.scenes & set(self._open):
            self._follow(name, self._open[name])
        return True

    def redo(self) -> bool:
        """Do again what was taken back; False where there is nothing."""
        if not self._undone:
            return False
        self._add(self._undone[-1])
        self._undone.pop()
        return True

    # ------------------------------------------------------------------ answers

    def labels(self, scan: str) -> LabelledScan:
        """Class, confidence and region of every point, at once: what is shown while one clicks."""
        return self.scan(scan).live(len(self.classes))

    def settled(self, scan: str, check: bool = True) -> LabelledScan:
        """Class, confidence and region of every point as :meth:`save` writes them, with the estimate; in seconds."""
        return self.scan(scan).settled(len(self.classes), check)

    def suggest(self, scan: str, count: int = 1) -> list[Suggestion]:
        """Points whose label would tell most, with reasons; a place is suggested once in a session."""
        return self.scan(scan).suggest(len(self.classes), count)

    def contradicted(self, scan: str) -> list[Suggestion]:
        """Labels that may be mistakes, since the others name another class there: the surest first, with what they say.

        The score is the share of what the others say that is for the class that they name.
        """
        opened = self.scan(scan)
        check = opened.check(len(self.classes))
        given = opened.annotated[check.points]
        return [
            Suggestion(
                int(check.points[row]),
                f'labelled {self.classes[given[row]]}, the other labels say {self.classes[check.said[row]]} '
                f'({100 * check.share[row]:.0f} %)',
                float(check.share[row]),
            )
            for row in contradicted(check, given)
        ]

    def agreement(self, scan: str) -> Float[np.ndarray, ' points']:
        """Share that the other labels give to the label in the region of each point; NaN: none is asked there."""
        return self.scan(scan).agreement(len(self.classes))

    def labelled_scans(self) -> list[str]:
        """Names of the scans that have a label."""
        clicked = [name for name in self.scans if self.log.actions(name)]
        return [name for name in clicked if (self.scan(name).annotated >= 0).any()]

    def save(self, out: Path, kind: str = SAME) -> list[Path]:
        """Write every scan that has a label with its classes, confidences and regions; returns the files.

        ``labels.json`` beside them names the classes, as that of ``rm3d label`` does.

        Args:
            out: Folder.
            kind: ``same``: the format of the input with all its fields; or one of
                :data:`rm3d_plugin.inference.predict_formats.FORMATS`.

        Raises:
            ConfigError: A file would replace one that was read, or the format is not known.
            SceneError: Nothing is labelled.
        """
        labelled = self.labelled_scans()
        if not labelled:
            raise SceneError('nothing to save: no point is labelled yet')
        check_outputs([self._paths[name] for name in labelled], [self.log.path], out, LabelOptions(format=kind))
        files: list[Path] = []
        given = GivenLabels(self.classes, tuple(range(len(self.classes))), {})
        summary = Summary(out, given)
        for name in labelled:
            scan, found = self.scan(name), self.settled(name, check=False)
            own = self._write(name, found, out, kind)
            summary.add(name, summary_of(WrittenScan(scan.path, scan_kind(scan.cloud), found, own), given))
            files += own
        return files

    def _write(self, name: str, found: LabelledScan, out: Path, kind: str) -> list[Path]:
        scan = self.scan(name)
        if kind == SAME:
            found, columns = scan.at_every_row(found), scan.columns
        else:
            columns = {each: values[scan.has_place] for each, values in scan.columns.items()}
        return write_scan(scan.path, columns, scan.cloud, found, self._given(name), out, kind)

    # ------------------------------------------------------------------ clicks of other programs

    def import_clicks(self, path: Path) -> int:
        """Take over clicks of a file (CSV, JSON or a log), one action; returns how many.

        Raises:
            ClickFileError, BudgetError: The file cannot be used, or a click is on no point of its scan.
        """
        return import_clicks(self, path)

    def export_clicks(self, path: Path) -> Path:
        """Write the clicks that stand, with the place of each in world coordinates: CSV, JSON or a log."""
        return export_clicks(self, path)

    def import_labels(self, scan: str, path: Path, field: str = 'label') -> int:
        """Take over the labels in a field of a file of the same points, one action; returns how many.

        See :func:`~rm3d_plugin.annotation.label_exchange.import_labels`.
        """
        return import_labels(self, scan, path, field)

    # ------------------------------------------------------------------ inside

    def _check_scenes(self) -> None:
        for scene in sorted(self.log.scenes - set(self._paths)):
            raise ClickFileError(
                f'{self.log.path}: holds clicks of scan {scene!r}, which is none of the scans: '
                f'{", ".join(self._paths)}; open that scan, too, or give another log'
            )

    def _checked_points(self, scan: str, points: Iterable[int]) -> list[int]:
        """The points, each once, ascending."""
        count, found = len(self.scan(scan).cloud), sorted({index(point) for point in points})
        if not found or found[0] < 0 or found[-1] >= count:
            got = f'point {found[0] if found[0] < 0 else found[-1]}' if found else 'no point'
            raise SceneError(f'scan {scan}: expected points 0..{count - 1}, got {got}')
        return found

    def _add(self, action: Action) -> None:
        self._done.append(self.log.act(action))
        for name in action.scenes & set(self._open):
            scan = self._open[name]
            clicks = [click for group in action.groups if group[0].scene == name for click in group]
            scan.set_labels(*_labelled(scan.annotated, scan.instance, clicks, scan.cloud))

    def _follow(self, name: str, scan: AnnotatedScan) -> None:
        """Label the points of a scan as the log says."""
        nothing = np.full(len(scan.cloud), UNLABELLED, dtype=np.int64)
        scan.set_labels(*_labelled(nothing, nothing, self.log.actions(name), scan.cloud))

    def _given(self, scan: str) -> GivenLabels:
        points = np.flatnonzero(self.scan(scan).annotated >= 0)
        labels = {scan: PointLabels(points, self.scan(scan).annotated[points])}
        values = (*range(len(self.classes)), UNLABELLED)  # the last, -1, stands for no class
        return GivenLabels(self.classes, values, labels)


def _labelled(
    annotated: Int[np.ndarray, ' points'],
    instance: Int[np.ndarray, ' points'],
    clicks: Sequence[Click],
    cloud: PointCloud,
) -> tuple[Int[np.ndarray, ' points'], Int[np.ndarray, ' points']]:
    """Classes and objects after clicks, of which the later counts."""
    annotated, instance = annotated.copy(), instance.copy()
    points = point_numbers(clicks, cloud)
    annotated[points] = [click.semantic for click in clicks]
    instance[points] = [click.instance for click in clicks]
    return annotated, instance
