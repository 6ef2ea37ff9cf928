"""What the labels of all scans together tell of each, where labels spread by a random walk: made at first use."""

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from tqdm import tqdm

from rm3d_plugin.pseudo_labels.propagation import Beside, Estimate, PreparedCloud, WalkerRules, examples_of
from rm3d_plugin.pseudo_labels.propagation.checked import (
    CheckedLabels,
    check_labels,
    estimate_across,
    joined,
    sharpness_of,
)
from rm3d_plugin.pseudo_labels.propagation.estimate import calibrated

CHECKED_SCANS = 16  # in about as many, evenly chosen, labels are left out

LabelledScan = tuple[PreparedCloud, Int[np.ndarray, ' points']]


class _Example(NamedTuple):
    points: Int[np.ndarray, ' examples']
    features: Float[np.ndarray, 'examples features']
    classes: Int[np.ndarray, ' examples']


class ScanKnowledge:
    """Examples of all scans, and how sure answers may be of themselves.

    Args:
        scene_ids: All scans.
        labelled: Gives a scan and the class of each of its labelled points, -1 elsewhere.
        classes: Number of classes.
        rules: Of the walk.
        judging: Share of the labels of each class that judge the network.
        seed: Of which these are.
    """

    def __init__(
        self,
        scene_ids: Sequence[str],
        labelled: Callable[[str], LabelledScan],
        classes: int,
        rules: WalkerRules,
        judging: float,
        seed: int,
    ) -> None:
        self._judging, self._seed = judging, seed
        self._scene_ids, self._labelled, self._classes, self._rules = scene_ids, labelled, classes, rules

    def beside(self, scene_id: str) -> Beside:
        """Examples of the other scans, and every class that any of them shows: it may be in this one, too."""
        others = [example for scene, example in self._examples.items() if scene != scene_id and len(example.classes)]
        if not others:
            return Beside()
        _, features, classes = (np.concatenate(column) for column in zip(*others, strict=True))
        return Beside(features, classes, possible=self.shown)

    @cached_property
    def shown(self) -> Bool[np.ndarray, ' classes']:
        """Classes of which some scan shows a label."""
        counts = [np.bincount(example.classes, minlength=self._classes) for example in self._examples.values()]
        return np.asarray(np.sum(counts, axis=0) > 0)

    @cached_property
    def checked(self) -> CheckedLabels:
        """What was said of labels that were left out, of all scans."""
        return joined(
            [
                check_labels(*labelled, self._classes, self._rules, self.beside(scene))
                for scene, labelled in self._scans('leaving labels out', CHECKED_SCANS)
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
        as_left_out = calibrated(np.concatenate(list(shares)), 1.0 / self.sharpness)
        return estimate_across(as_left_out, self.checked, self._rules.draws, np.random.default_rng(self._seed))

    @cached_property
    def judges(self) -> dict[str, Int[np.ndarray, ' judging']]:
        """Points of each scan whose labels training is not told, so that they can judge: a share of each class."""
        scenes, examples = list(self._examples), self._examples.values()
        owner = np.repeat(np.arange(len(scenes)), [len(example.classes) for example in examples])
        points = np.concatenate([example.points for example in examples])
        kept = share_of_each(np.concatenate([example.classes for example in examples]), self._judging, self._seed)
        return {scene: np.sort(points[kept & (owner == number)]) for number, scene in enumerate(scenes)}

    @cached_property
    def _examples(self) -> dict[str, _Example]:
        return {
            scene: _Example(np.flatnonzero(annotated >= 0), *examples_of(scan, annotated))
            for scene, (scan, annotated) in self._scans('what classes look like')
        }

    def _scans(self, task: str, most: int | None = None) -> Iterator[tuple[str, LabelledScan]]:
        step = 1 if most is None else max(len(self._scene_ids) // most, 1)
        for scene in tqdm(self._scene_ids[::step], desc=task, leave=False):
            yield scene, self._labelled(scene)


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
