"""What the labels of all scans together tell of each, where labels spread by a random walk: made at first use."""

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from tqdm import tqdm

from rm3d_plugin.pseudo_labels.propagation import Beside, Estimate, PreparedCloud, WalkerRules, examples_of
from rm3d_plugin.pseudo_labels.propagation.checked import (
    CheckedLabels,
    check_labels,
    joined,
    sharpness_of,
)
from rm3d_plugin.pseudo_labels.propagation.estimate import calibrated, estimate_miou
from rm3d_plugin.pseudo_labels.propagation.labels import one_of_each, places_of
from rm3d_plugin.structures import PointCloud

TEACHING_SCANS = 128  # about as many, evenly chosen, teach what classes look like
CHECKED_SCANS = 16  # in about as many labels are left out


class _Labels(NamedTuple):
    points: Int[np.ndarray, ' labels']
    classes: Int[np.ndarray, ' labels']


class _Example(NamedTuple):
    features: Float[np.ndarray, 'examples features']
    classes: Int[np.ndarray, ' examples']


class ScanKnowledge:
    """Examples of all scans, and how sure answers may be of themselves.

    Args:
        scene_ids: All scans.
        cloud: Gives the points of a scan.
        scan: Gives a scan, prepared.
        annotated: Gives the class of each labelled point of a scan, -1 elsewhere.
        classes: Number of classes.
        rules: Of the walk.
        judging: Share of the places of each class whose labels judge the network.
        seed: Of which these are.
    """

    def __init__(
        self,
        scene_ids: Sequence[str],
        cloud: Callable[[str], PointCloud],
        scan: Callable[[str], PreparedCloud],
        annotated: Callable[[str], Int[np.ndarray, ' points']],
        classes: int,
        rules: WalkerRules,
        judging: float,
        seed: int,
    ) -> None:
        self._scene_ids, self._cloud, self._scan, self._annotated = scene_ids, cloud, scan, annotated
        self._classes, self._rules, self._judging, self._seed = classes, rules, judging, seed

    def beside(self, scene_id: str) -> Beside:
        """Examples of the other scans, and every class that any of them shows: it may be in this one, too."""
        others = [example for scene, example in self._examples.items() if scene != scene_id and len(example.classes)]
        if not others:
            return Beside()
        features, classes = (np.concatenate(column) for column in zip(*others, strict=True))
        return Beside(features, classes, possible=self.shown)

    @cached_property
    def shown(self) -> Bool[np.ndarray, ' classes']:
        """Classes of which some scan shows a label."""
        there = np.zeros(self._classes, dtype=np.bool_)
        there[np.concatenate([labels.classes for labels in self._labels.values()])] = True
        return there

    @property
    def count(self) -> int:
        """Labels of all scans."""
        return sum(len(labels.classes) for labels in self._labels.values())

    @cached_property
    def checked(self) -> CheckedLabels:
        """What was said of labels that were left out, of all scans."""
        return joined(
            [
                check_labels(self._scan(scene), self._annotated(scene), self._classes, self._rules, self.beside(scene))
                for scene in self._some(CHECKED_SCANS, 'leaving labels out')
            ]
        )

    @cached_property
    def sharpness(self) -> float:
        """Power of the probabilities by which answers are right as often as they say."""
        return sharpness_of(self.checked)

    def estimate(self, shares: Sequence[Float[np.ndarray, '_ classes']]) -> Estimate | None:
        """Of the mean IoU of answers over all scans, from the labels that were left out.

        Args:
            shares: Probabilities of points without a label, as sharp as :attr:`sharpness` makes them, of each scan.
        """
        counts = np.bincount(self.checked.classes, minlength=self._classes)
        there = np.flatnonzero((self.checked.found > 0) | (counts > 0))
        as_left_out = calibrated(np.concatenate(list(shares))[:, there], 1.0 / self.sharpness)
        left, classes = self.checked.shares[:, there], np.searchsorted(there, self.checked.classes)
        return estimate_miou(as_left_out, left, classes, self._rules.draws, np.random.default_rng(self._seed))

    @cached_property
    def judges(self) -> dict[str, Int[np.ndarray, ' judging']]:
        """Points of each scan whose labels training is not told, so that they can judge: a share of each class.

        Drawn by place: a network that was taught a part of a stroke knows the rest.
        """
        places = {scene: self._places(scene) for scene in tqdm(self._labels, desc='places of labels', leave=False)}
        firsts = {scene: one_of_each(own) for scene, own in places.items()}
        classes = np.concatenate([self._labels[scene].classes[rows] for scene, rows in firsts.items()])
        ends = np.cumsum([len(rows) for rows in firsts.values()])
        kept = np.split(share_of_each(classes, self._judging, self._seed), ends[:-1])
        return {
            scene: self._labels[scene].points[np.isin(places[scene], places[scene][rows[chosen]])]
            for (scene, rows), chosen in zip(firsts.items(), kept, strict=True)
        }

    def _places(self, scene_id: str) -> Int[np.ndarray, ' labels']:
        points, classes = self._labels[scene_id]
        if len(np.unique(classes)) == len(classes):
            return np.arange(len(classes))
        return places_of(self._cloud(scene_id).xyz, points, classes)

    @cached_property
    def _labels(self) -> dict[str, _Labels]:
        found = {}
        for scene in self._scene_ids:
            annotated = self._annotated(scene)
            points = np.flatnonzero(annotated >= 0)
            found[scene] = _Labels(points, annotated[points].astype(np.int64))
        return found

    @cached_property
    def _examples(self) -> dict[str, _Example]:
        return {
            scene: _Example(*examples_of(self._scan(scene), self._annotated(scene)))
            for scene in self._some(TEACHING_SCANS, 'what classes look like')
        }

    def _some(self, most: int, task: str) -> Iterable[str]:
        """About so many of the scans, with a progress bar."""
        step = max(len(self._scene_ids) // most, 1)
        chosen: Iterable[str] = tqdm(self._scene_ids[::step], desc=task, leave=False)
        return chosen


def share_of_each(classes: Int[np.ndarray, ' labels'], share: float, seed: int) -> Bool[np.ndarray, ' labels']:
    """Some labels of each class, by chance; rounded down, so that a class with few keeps all.

    >>> np.bincount(np.repeat([0, 1], [10, 4])[share_of_each(np.repeat([0, 1], [10, 4]), 0.2, 0)], minlength=2)
    array([2, 0])
    """
    chosen = np.zeros(len(classes), dtype=np.bool_)
    generator = np.random.default_rng(seed)
    for own in np.unique(classes):
        rows = generator.permutation(np.flatnonzero(classes == own))
        chosen[rows[: int(share * len(rows))]] = True
    return chosen
