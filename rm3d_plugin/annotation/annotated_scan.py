"""A scan that is being labelled: what is computed once, and what every click changes."""

import threading
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.annotation.label_check import LabelCheck, check_given
from rm3d_plugin.annotation.object_fit import object_points
from rm3d_plugin.annotation.suggestions import Suggester, Suggestion
from rm3d_plugin.inference.label_scan import (
    LabelledScan,
    at_all_points,
    drawn_points,
    label_prepared,
    nearest_drawn,
    prepare_drawn,
    regions_of_prepared,
)
from rm3d_plugin.pseudo_labels.propagation import Beside, PreparedCloud
from rm3d_plugin.pseudo_labels.propagation.live import LiveAnswer, LivePropagation
from rm3d_plugin.storage.columns import read_columns
from rm3d_plugin.storage.scans import rows_with_place, scan_of_columns
from rm3d_plugin.structures import UNLABELLED, PointCloud, SceneError

MOST_POINTS = 1_000_000  # that labels spread over while one clicks; of larger scans so many are drawn


class AnnotatedScan:
    """A scan, its graph, and what labels say of its points.

    Args:
        path: The file.
        columns: See :func:`rm3d_plugin.storage.scans.read_scan`.
        drop_nan: Pass over points whose place is NaN.

    Raises:
        SceneError: The scan cannot be read, or has no point.
    """

    def __init__(self, path: Path, columns: str | None = None, drop_nan: bool = False) -> None:
        self.path, self.columns = path, read_columns(path, columns)
        self.cloud: PointCloud = scan_of_columns(self.columns, path, nan_points='drop' if drop_nan else 'error').cloud
        if not len(self.cloud):
            raise SceneError(f'{path}: has no point to label')
        self._annotated = np.full(len(self.cloud), UNLABELLED, dtype=np.int64)
        self._instance = self._annotated
        self._suggested: set[int] = set()
        self._answering = threading.Lock()
        self._drawn = drawn_points(len(self.cloud), np.zeros(0, dtype=np.int64), MOST_POINTS)

    # ------------------------------------------------------------------ computed once

    @cached_property
    def has_place(self) -> Bool[np.ndarray, ' rows']:
        """Which rows of the file are points of the cloud."""
        return rows_with_place(self.columns, None, self.path)

    @cached_property
    def scene(self) -> PreparedCloud:
        """Graph and features of the points that labels spread over: all, or those that were drawn."""
        return prepare_drawn(self.cloud, self._drawn)

    @cached_property
    def region(self) -> Int[np.ndarray, ' points']:
        """Region of each point."""
        return regions_of_prepared(self.scene)[self._nearest]

    @cached_property
    def _nearest(self) -> Int[np.ndarray, ' points']:
        """Which drawn point stands for each."""
        whole = len(self._drawn) == len(self.cloud)
        return np.arange(len(self.cloud)) if whole else nearest_drawn(self.cloud, self._drawn)

    @cached_property
    def _live(self) -> LivePropagation:
        return LivePropagation(self.scene)

    @cached_property
    def _suggester(self) -> Suggester:
        return Suggester(self._live)

    # ------------------------------------------------------------------ labels

    @property
    def annotated(self) -> Int[np.ndarray, ' points']:
        """Class of each labelled point, -1 elsewhere."""
        return self._annotated

    @property
    def instance(self) -> Int[np.ndarray, ' points']:
        """Object of each labelled point, -1 = none."""
        return self._instance

    def set_labels(self, annotated: Int[np.ndarray, ' points'], instance: Int[np.ndarray, ' points']) -> None:
        """Labels that stand now, in place of those before.

        Args:
            annotated: Class of each point, -1 = unlabelled.
            instance: Object of each, -1 = none.
        """
        self._annotated, self._instance = annotated, instance

    def object_points(self, may_be: Bool[np.ndarray, ' points'], number: int) -> Int[np.ndarray, ' inside']:
        """:func:`~rm3d_plugin.annotation.object_fit.object_points` over the graph of the scan.

        Args:
            may_be: Points that are of the object's class.
            number: Of the object.

        Raises:
            SceneError: No point of the object is labelled.
        """
        own = np.flatnonzero(self._instance == number)
        if not len(own):
            raise SceneError(f'{self.path}: object {number} has no labelled point: click one')
        owner = np.full(len(self._drawn), UNLABELLED, dtype=np.int64)
        labelled = np.flatnonzero(self._instance >= 0)
        owner[self._nearest[labelled]] = self._instance[labelled]
        owner[self._nearest[own]] = number
        xyz, edges = self.scene.cloud.xyz, self.scene.graphs[0].weights
        found = object_points(xyz, edges, may_be[self._drawn], owner, number)
        return np.flatnonzero(np.isin(self._nearest, found) & (may_be | (self._instance == number)))

    def live(self, num_classes: int) -> LabelledScan:
        """What the labels say of every point, at once; near to :meth:`settled`."""
        points, classes, _ = self._on_drawn()
        answer = self._answer(num_classes, points, classes)
        said, known = answer.shares.argmax(axis=1), answer.shares.sum(axis=1) > 0
        semantic = np.where(known, said, UNLABELLED)[self._nearest]
        confidence = answer.shares.max(axis=1, initial=0.0)[self._nearest]
        labelled = self._annotated >= 0
        semantic[labelled], confidence[labelled] = self._annotated[labelled], 1.0
        return LabelledScan.spread(semantic, confidence, self.region, self._counts(num_classes))

    def settled(self, num_classes: int, check: bool = True) -> LabelledScan:
        """What is written in the end: :func:`~rm3d_plugin.inference.label_scan.label_scan`, in seconds.

        Args:
            num_classes: Number of classes.
            check: Leave labels out, for the estimate.
        """
        labelled = np.flatnonzero(self._annotated >= 0)
        if not len(labelled):
            return self.live(num_classes)
        on_drawn = np.full(len(self._drawn), UNLABELLED, dtype=np.int64)
        points, classes, _ = self._on_drawn()
        on_drawn[points] = classes
        found = label_prepared(self.scene, on_drawn, num_classes, check, 0, Beside())
        found = at_all_points(found, self.cloud, self._drawn)
        found.semantic[labelled], found.confidence[labelled] = self._annotated[labelled], 1.0
        return found

    def at_every_row(self, found: LabelledScan) -> LabelledScan:
        """Labels of the points as labels of the rows of the file: -1 and confidence 0 at those without a place."""
        rows = self.has_place
        if rows.all():
            return found
        fill = np.full(len(rows), UNLABELLED, dtype=np.int64)
        semantic, region, confidence = fill, fill.copy(), np.zeros(len(rows), np.float32)
        semantic[rows], region[rows], confidence[rows] = found.semantic, found.region, found.confidence
        return replace(found, semantic=semantic, region=region, confidence=confidence)

    def suggest(self, num_classes: int, count: int = 1) -> list[Suggestion]:
        """Points whose label would tell most; a place is suggested once.

        Args:
            num_classes: Number of classes.
            count: How many.
        """
        points, classes, _ = self._on_drawn()
        answer = self._answer(num_classes, points, classes)
        found = self._suggester.suggest(answer, points, classes, self._suggested, count)
        self._suggested |= {each.point for each in found}
        return [each._replace(point=int(self._drawn[each.point])) for each in found]

    def check(self, num_classes: int) -> LabelCheck:
        """What the other labels say of each label; of labels that one drawn point stands for, of the first.

        Args:
            num_classes: Number of classes.
        """
        points, classes, own = self._on_drawn()
        return check_given(self.scene, partial(self._answer, num_classes), points, classes)._replace(points=own)

    def agreement(self, num_classes: int) -> Float[np.ndarray, ' points']:
        """Share that the other labels give to the label in a point's region, the least of several; NaN: none is asked.

        Args:
            num_classes: Number of classes.
        """
        found = self.check(num_classes)
        asked = ~np.isnan(found.own)
        least = np.full(int(self.region.max()) + 1, np.inf)
        np.minimum.at(least, self.region[found.points[asked]], found.own[asked])
        return np.where(np.isinf(least), np.nan, least)[self.region]

    def _answer(
        self, num_classes: int, points: Int[np.ndarray, ' labelled'], classes: Int[np.ndarray, ' labelled']
    ) -> LiveAnswer:
        """One at a time: a check of labels runs beside clicks."""
        with self._answering:
            return self._live.answer(points, classes, num_classes)

    def _on_drawn(
        self,
    ) -> tuple[Int[np.ndarray, ' labelled'], Int[np.ndarray, ' labelled'], Int[np.ndarray, ' labelled']]:
        """Labelled points as drawn ones, each once, their classes, and which points they are of the scan.

        A point that was not drawn labels the one that stands for it.
        """
        labelled = np.flatnonzero(self._annotated >= 0)
        points, first = np.unique(self._nearest[labelled], return_index=True)
        return points, self._annotated[labelled][first], labelled[first]

    def _counts(self, num_classes: int) -> Int[np.ndarray, ' classes']:
        return np.bincount(self._annotated[self._annotated >= 0], minlength=num_classes)
