"""Where the next click is worth most, and why."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.propagation.class_shares import LENGTH
from rm3d_plugin.pseudo_labels.propagation.labels import one_of_each
from rm3d_plugin.pseudo_labels.propagation.live import LiveAnswer, LivePropagation
from rm3d_plugin.pseudo_labels.propagation.region_scales import RegionScale, region_means

MOST_REGIONS = 1000  # that may be suggested and stand for all; of more, evenly chosen
NOISE = 0.05  # of what a click tells of its region, against 2 of what is not known before any click


class Suggestion(NamedTuple):
    """A place to click.

    Attributes:
        point: In the middle of a region.
        reason: In words.
        score: What a click there is expected to tell of all points, in a unit of its own.
    """

    point: int
    reason: str
    score: float


class _Doubt(NamedTuple):
    """Why regions may be wrong, each in [0, 1].

    Attributes:
        mixed: Mean share of other classes than the likeliest.
        new: How unlike they are to all regions with a click.
        far: How little the clicks tell of them over the graphs.
        unknown: Chance that a region is of a class that nobody has clicked.
    """

    mixed: Float[np.ndarray, ' regions']
    new: Float[np.ndarray, ' regions']
    far: Float[np.ndarray, ' regions']
    unknown: float


class Suggester:
    """Asks for the click that tells most of what is not known.

    Regions tell of each other by how alike they look and by how near they are over the graphs. Under a Gaussian process
    with this covariance, a click on one takes Q_ij^2 / (Q_ii + noise) off the variance of each other, where Q is what
    the clicks so far have left of it (Cohn, Ghahramani and Jordan 1996). The sum of that over all regions, each by its
    points and by how doubtful its label is, is the score. Doubtful are shares of other classes, and the chance that it
    is a class that nobody has clicked yet: the share of clicks that are the only one of their class (Good 1953).

    Attributes:
        regions: That may be suggested and stand for all.
        points: In the middle of each.

    Args:
        live: The scan, and how labels spread over it.
    """

    def __init__(self, live: LivePropagation) -> None:
        scale: RegionScale = live.scene.scales[-1]
        count = len(scale.sizes)
        self.regions = np.linspace(0, count - 1, min(count, MOST_REGIONS)).astype(np.int64)
        self._scale, self._sizes = scale, scale.sizes[self.regions] / max(int(scale.sizes.sum()), 1)
        self.points = _middles(live.scene.cloud.xyz, scale)[self.regions]
        self._rows = scale.scaling.apply(scale.features)
        self._looks = self._alike(self._rows[self.regions])
        self._graphs, self._places = live.alike(self.points), live.places

    def suggest(
        self,
        answer: LiveAnswer,
        points: Int[np.ndarray, ' labelled'],
        classes: Int[np.ndarray, ' labelled'],
        taken: set[int],
        count: int = 1,
    ) -> list[Suggestion]:
        """The best places, each in another region, each as if those before were clicked.

        Args:
            answer: What is said of each point.
            points: Labelled ones.
            classes: Of these.
            taken: Points that are not to be suggested again.
            count: How many.
        """
        clicked, out = self._nearest_kept(points), list[Suggestion]()
        classes = classes[one_of_each(self._places(points, classes))]  # of places: a stroke is seen once
        closed = np.isin(self.points, list(taken)) | np.isin(self.regions, self._scale.region[points])
        for _ in range(count):
            doubt = self._doubt(answer, clicked, classes)
            score = np.where(closed, -1.0, self._told(self._sizes * (doubt.mixed + doubt.unknown), clicked))
            best = int(score.argmax()) if len(score) else -1
            if best < 0 or closed[best]:
                break
            out.append(Suggestion(int(self.points[best]), _reason(doubt, best, len(clicked)), float(score[best])))
            closed[best], clicked = True, np.append(clicked, best)
        return out

    def _told(
        self, weight: Float[np.ndarray, ' regions'], clicked: Int[np.ndarray, ' clicked']
    ) -> Float[np.ndarray, ' regions']:
        """Variance that a click on each region takes off all, each by its weight."""
        left = self._looks + self._graphs
        if len(clicked):
            rows = np.unique(clicked)
            known = left[np.ix_(rows, rows)] + NOISE * np.eye(len(rows))
            left = left - left[:, rows] @ np.linalg.solve(known, left[rows])
        return np.asarray(np.square(left) @ weight / (np.maximum(np.diag(left), 0.0) + NOISE))

    def _doubt(
        self, answer: LiveAnswer, clicked: Int[np.ndarray, ' clicked'], classes: Int[np.ndarray, ' labelled']
    ) -> _Doubt:
        if not len(clicked):
            ones = np.ones(len(self.regions))
            return _Doubt(0.0 * ones, ones, ones, 1.0)
        mean = self._scale.mean(answer.shares)[self.regions]
        only = int(np.count_nonzero(np.bincount(classes) == 1))
        near = self._looks[:, clicked].max(axis=1), self._graphs[:, clicked].max(axis=1)
        unknown = max(only, 1) / max(len(classes), 1)
        return _Doubt(1.0 - mean.max(axis=1, initial=0.0), 1.0 - near[0], 1.0 - near[1], unknown)

    def _nearest_kept(self, points: Int[np.ndarray, ' labelled']) -> Int[np.ndarray, ' clicked']:
        """The regions that stand for those of the points, each once: themselves, or those that look most like them."""
        rows = self._rows[np.unique(self._scale.region[points])]
        if not len(rows):
            return np.zeros(0, dtype=np.int64)
        return np.unique(self._alike(rows, self._rows[self.regions]).argmax(axis=1))

    @staticmethod
    def _alike(
        rows: Float[np.ndarray, 'rows features'], others: Float[np.ndarray, 'others features'] | None = None
    ) -> Float[np.ndarray, 'rows others']:
        others = rows if others is None else others
        squared = np.square(rows).sum(axis=1)[:, None] + np.square(others).sum(axis=1) - 2.0 * rows @ others.T
        return np.exp(np.maximum(squared, 0.0).astype(np.float64) / (-2.0 * LENGTH**2))


def _reason(doubt: _Doubt, region: int, clicks: int) -> str:
    if not clicks:
        return 'much of the scan looks like this'
    mixed, new, far = float(doubt.mixed[region]), float(doubt.new[region]), float(doubt.far[region])
    if new * doubt.unknown >= mixed:
        return 'looks like nothing that was clicked: a new class?'
    if mixed >= 1 / 3:
        return f'mixed labels: {100 * mixed:.0f} % speaks for other classes'
    return 'far from every click' if far > new else 'unlike what was clicked'


def _middles(xyz: Float[np.ndarray, 'points 3'], scale: RegionScale) -> Int[np.ndarray, ' regions']:
    """The point of each region that is nearest to its mean."""
    off = xyz - region_means(xyz, scale.region, scale.sizes)[scale.region]
    order = np.lexsort((np.square(off).sum(axis=1), scale.region))
    return order[np.flatnonzero(np.diff(scale.region[order], prepend=-1))]
