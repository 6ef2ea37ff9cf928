"""Where a made-up annotator clicks next, by published scores and by ours; each works on the same regions.

- ``chance``: any point with a class.
- ``ours``: :class:`~rm3d_plugin.annotation.suggestions.Suggester`.
- ``entropy``: of a region's mean shares of the classes.
- ``mixture``: entropy of the named classes in a region (Annotator, Xie et al. 2023), which over-confident shares leave
  alone.
- ``redal``: entropy, colour gradient and surface variation of a region; each earlier click in a cluster of alike
  regions takes a twentieth off (ReDAL, Wu et al. 2021).
"""

from collections.abc import Callable
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.annotation.suggestions import Suggester
from rm3d_plugin.baselines.redal import CLUSTERS, DECAY, alike, class_entropy, surface_interest
from rm3d_plugin.pseudo_labels.propagation.live import LiveAnswer, LivePropagation

SCORES = ('chance', 'ours', 'entropy', 'mixture', 'redal')
Next = Callable[[LiveAnswer, Int[np.ndarray, ' clicked'], set[int]], int | None]


class ClickChooser:
    """Ways to choose the next click on a scan.

    Args:
        live: The scan, and how labels spread over it.
        semantic: Class of each point, -1 = unknown: nobody clicks there.
    """

    def __init__(self, live: LivePropagation, semantic: Int[np.ndarray, ' points']) -> None:
        self._live, self._semantic = live, semantic
        self._asked = np.flatnonzero(semantic >= 0)

    @cached_property
    def suggester(self) -> Suggester:
        """Ours; the others take its regions, too."""
        return Suggester(self._live)

    @cached_property
    def _surface(self) -> Float[np.ndarray, ' regions']:
        cloud, scale = self._live.scene.cloud, self._live.scene.scales[-1]
        return scale.mean(surface_interest(cloud)[:, None])[self.suggester.regions, 0]

    @cached_property
    def _cluster(self) -> Int[np.ndarray, ' regions']:
        return alike(self._live.scene.scales[-1].features[self.suggester.regions], np.random.default_rng(0))

    def by(self, name: str, seed: int) -> Next:
        """How the next point is chosen.

        Args:
            name: One of :data:`SCORES`.
            seed: Of chance; but for 0, the first click of every score is by chance.
        """
        generator = np.random.default_rng(seed)
        choose = {'chance': lambda *_: None, 'ours': self._ours}.get(name, self._uncertain(name))

        def chosen(answer: LiveAnswer, points: Int[np.ndarray, ' clicked'], seen: set[int]) -> int | None:
            if name == 'chance' or (not len(points) and (seed or name != 'ours')):
                return int(generator.choice(self._asked[~np.isin(self._asked, points)]))
            return choose(answer, points, seen)

        return chosen

    def _ours(self, answer: LiveAnswer, points: Int[np.ndarray, ' clicked'], seen: set[int]) -> int | None:
        found = self.suggester.suggest(answer, points, self._semantic[points], seen)
        return found[0].point if found else None

    def _uncertain(self, name: str) -> Next:
        """The middle of the region with the highest score that was not seen."""

        def choose(answer: LiveAnswer, points: Int[np.ndarray, ' clicked'], seen: set[int]) -> int | None:
            score, middle = self._scored(name, answer, points), self.suggester.points
            score[np.isin(middle, [*seen, *points.tolist()])] = -1.0
            return int(middle[score.argmax()]) if score.max() >= 0 else None

        return choose

    def _scored(
        self, name: str, answer: LiveAnswer, points: Int[np.ndarray, ' clicked']
    ) -> Float[np.ndarray, ' regions']:
        scale, regions = self._live.scene.scales[-1], self.suggester.regions
        if name == 'redal':
            score = scale.mean(class_entropy(answer.shares)[:, None])[regions, 0] + self._surface
            nearest = np.abs(regions[:, None] - scale.region[points]).argmin(axis=0)  # regions that stand for all
            return np.asarray(score * DECAY ** np.bincount(self._cluster[nearest], minlength=CLUSTERS)[self._cluster])
        named = answer.shares if name == 'entropy' else np.eye(answer.shares.shape[1])[answer.shares.argmax(axis=1)]
        return _entropy(scale.mean(named)[regions])


def _entropy(shares: Float[np.ndarray, 'rows classes']) -> Float[np.ndarray, ' rows']:
    """In bits."""
    return np.asarray(-(shares * np.log2(np.maximum(shares, 1e-9))).sum(axis=1))
