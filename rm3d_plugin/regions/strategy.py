"""How regions merge: thresholds, switches and the schedule of the weights (METHOD 6)."""

from dataclasses import dataclass, fields
from math import isfinite
from typing import Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Float, Int

Thresholds = Literal['normalised', 'literal']
Pooling = Literal['mean', 'max']
MixedRegions = Literal['majority', 'nearest']
PriorLooks = Literal['neighbors', 'kernel']


class TermWeights(NamedTuple):
    """The weights y1..y4 of S; zero for a term that is switched off."""

    color: float
    scale: float
    descriptor: float
    semantics: float


@dataclass(frozen=True)
class MergeStrategy:
    """Every number of the merging step, and nothing that changes while it runs.

    S is a weighted sum of four similarities whose weights move from geometry to semantics. Printed thresholds on the
    sum cannot be reached late in the schedule (Condition 4 for t > .75, Condition 3 for t > .875), so the default
    compares the weighted *mean* with half of each threshold, which is the same at t = 1/2; ``thresholds='literal'``
    keeps the printed rule.

    Attributes:
        tau_merge: Condition 3, S from which two regions merge (a sum, as printed); larger: fewer merges.
        tau_seed: Condition 4, S from which a merged region lets the group grow on; larger: shorter chains.
        thresholds: 'normalised' compares S / sum(y) with tau / 2, 'literal' compares S with tau.
        gamma: Softmax from which a region is confident; larger: fewer and purer labels.
        lambda_seg: Steepness of the semantic similarity exp(-lambda |p - q|^2).
        lambda_normal: Weight of the normals in the affinity (Condition 1 and the descriptor similarity).
        lambda_descriptor: Weight of the descriptors in the affinity.
        weight_balancing: False gives every term the weight 1 in every round.
        use_color: Keep the colour (or intensity) term.
        use_scale: Keep the scale term.
        use_descriptor: Keep the affinity of normals and descriptors.
        use_semantics: Keep the network's term.
        use_normal_affinity: Keep the normals within the affinity.
        use_descriptor_affinity: Keep the descriptors within the affinity.
        permanent: True keeps every label once given; False demotes those that lose the network's support.
        demote_margin: A label falls when its class's pooled probability is under ``gamma - demote_margin``.
        pooling: 'mean' of the points' softmax over a region, or their 'max' per class, renormalised (as printed).
        color_sigma: Lab distance at which the colour similarity is exp(-1/2).
        intensity_sigma: The same for a lidar's return strength in [0, 1].
        centre_distance: Regions of one class are one instance if their shifted centres are nearer than this (metres);
            one number for all classes, one a class (None: not asked for that class), or None: never asked.
        rounds: Rounds in which the weights go from (1, 1, 1, 0) to (0, 0, 0, 1).
        seed_share: Share of the regions, flattest first, that are seeds beside the labelled ones.
        quota: Class-balanced self-training (Zou et al., ECCV 2018): in the first round with predictions each scene
            takes, class by class, only its most confident network-given groups, up to this share of their points; the
            share grows by round to 1. Smaller: slower and purer. None: every confident group at once.
        quota_ranges: Lower ends of range bins, metres from the sensor, each with a quota of its own; (): one bin.
        mixed_regions: What a region with true labels of several classes spreads: their 'majority' (METHOD 1), or to
            each point the class of the labelled point 'nearest' to it in place and colour.
        near_place: Metres that count as much as ``near_color`` in that, and in the next.
        near_color: RGB difference, of 1, that counts as much as ``near_place``.
        spread_color: RGB difference, of 1, from the near and alike annotated point of a region up to which its points
            take an annotated class; the rest of the region asks the network. Smaller: fewer and purer labels. None: no
            limit. Segmentation of coloured scans only.
        spread_extent: An annotated point speaks for its region only where that is at most this many times as long as
            the regions of its class usually are (their median over all training scenes); else for itself alone, and the
            region asks the network. Smaller: fewer and purer labels. None: no limit. Segmentation only.
        region_prior: Multiply the network's softmax with what each region may be by its shape, its colour and how near
            annotated points lie (see :mod:`rm3d_plugin.pseudo_labels.region_prior.prior`); in the first round that
            stands alone. A
            class of which a scene holds no annotated point is out, which is true of budgets that show one of each
            class there is, as all budgets of points here do, and not of clicks that leave out a class. Segmentation
            only.
        prior_looks: With ``region_prior``: what shapes say. 'neighbors': the most alike labelled regions vote, and
            colours count. 'kernel': a classifier that labelled regions of all scenes teach says how likely each class
            is, times how frequent it seems to be; for scenes of one sensor, whose ranges and brightness it sees, and
            budgets that show as many points of each class (see
            :mod:`rm3d_plugin.pseudo_labels.region_prior.classifier`);
            with fewer than 15 labelled regions in all they vote.
        heading: The sensor travels along x, as on vehicles, and streets run that way: how far aside of its path things
            lie is part of their looks.
        prior_scale: With ``region_prior``: metres at which an annotated point's word has begun to fade, slowly, as
            suits
            scenes with many small things of a class. None: it fades as fast as regions of its class are short, which
            suits scenes where most things have an annotated point. See
            :func:`~rm3d_plugin.pseudo_labels.region_prior.prior.nearness`.
        inverse_temperature: With ``region_prior``: the softmax is raised to this power before, so it counts so many
            times against what regions may be. Larger: trusts the network more, and regions are named more readily.
        missing_points: With ``region_prior``: a region that would hold so many annotated points, were they spread
            evenly, but holds none, is of no class, and nothing names it. For points annotated by chance, not class by
            class, where some things have no class. Smaller: less is labelled. None: any region may have a class.
        new_instances: A group of a thing class in which no instance was annotated is an instance of its own. False: its
            points are of no known instance, so that pieces of an object do not teach offsets to their own middles.
            Segmentation only.
        level_regions: Regions whose mean normal is this upright (its z in [0, 1]) are not bounded by what they hold:
            road and pavement lie in one plane. So annotated points on them do not speak for their region; each point on
            them takes the class of the nearest annotated one, with differences of height, as of a kerb, counted more,
            and after the first round, anew in each, what the network and those distances say together (see
            :mod:`rm3d_plugin.pseudo_labels.ground.labels`). Smaller: slopes too. None: no region is so. Segmentation
            only.
        level_looks: How level points look, too, and what annotated ones of all scenes teach of that, names them, in the
            first round and for good (see :mod:`rm3d_plugin.pseudo_labels.ground.classifier`); where hardly any are
            annotated it is as without. Segmentation only.
        level_reach: Metres up to which an annotated point names level points in the first round. Larger: more and less
            pure labels. None: no limit.
        holdout: Share of the annotated points of a scene that is kept aside to check the labels of each round, and
            neither trained on nor used for merging; 0: no check. Segmentation only.
        holdout_margin: A round's new labels are dropped where the share of kept-aside points that they contradict
            exceeds the former round's by more than this; larger: fewer rounds are rolled back.

    Raises:
        ValueError: A value is out of its range; the message names the field.
    """

    tau_merge: float = 1.25
    tau_seed: float = 1.5
    thresholds: Thresholds = 'normalised'
    gamma: float = 0.75
    lambda_seg: float = 2.0
    lambda_normal: float = 1.0
    lambda_descriptor: float = 1.0
    weight_balancing: bool = True
    use_color: bool = True
    use_scale: bool = True
    use_descriptor: bool = True
    use_semantics: bool = True
    use_normal_affinity: bool = True
    use_descriptor_affinity: bool = True
    permanent: bool = True
    demote_margin: float = 0.15
    pooling: Pooling = 'mean'
    color_sigma: float = 15.0
    intensity_sigma: float = 0.1
    centre_distance: float | tuple[float | None, ...] | None = None
    rounds: int = 8
    seed_share: float = 0.002
    quota: float | None = None
    quota_ranges: tuple[float, ...] = ()
    mixed_regions: MixedRegions = 'majority'
    near_place: float = 0.5
    near_color: float = 0.16
    spread_color: float | None = None
    spread_extent: float | None = None
    region_prior: bool = False
    prior_looks: PriorLooks = 'neighbors'
    heading: bool = False
    prior_scale: float | None = None
    inverse_temperature: float = 1.0
    missing_points: float | None = None
    new_instances: bool = True
    level_regions: float | None = None
    level_looks: bool = False
    level_reach: float | None = None
    holdout: float = 0.0
    holdout_margin: float = 0.05

    def __post_init__(self) -> None:
        for name in ('tau_merge', 'tau_seed'):
            self._check(name, 0 <= getattr(self, name) <= 4, 'a sum of four similarities, in [0, 4]')
        self._check('tau_seed', self.tau_seed >= self.tau_merge, f'at least tau_merge = {self.tau_merge}')
        self._check('thresholds', self.thresholds in get_args(Thresholds), f'one of {get_args(Thresholds)}')
        self._check('prior_looks', self.prior_looks in get_args(PriorLooks), f'one of {get_args(PriorLooks)}')
        self._check('pooling', self.pooling in get_args(Pooling), f'one of {get_args(Pooling)}')
        self._check('gamma', 0 < self.gamma <= 1, 'a probability in (0, 1]')
        for name in ('lambda_seg', 'lambda_normal', 'lambda_descriptor'):
            self._check(name, isfinite(getattr(self, name)) and getattr(self, name) >= 0, 'a number >= 0')
        self._check('demote_margin', 0 <= self.demote_margin <= self.gamma, 'in [0, gamma]')
        self._check('mixed_regions', self.mixed_regions in get_args(MixedRegions), f'one of {get_args(MixedRegions)}')
        for name in ('color_sigma', 'intensity_sigma', 'near_place', 'near_color', 'inverse_temperature'):
            self._check(name, isfinite(getattr(self, name)) and getattr(self, name) > 0, 'a number > 0')
        for name in ('spread_color', 'spread_extent', 'prior_scale', 'missing_points', 'level_reach'):
            limit = getattr(self, name)
            self._check(name, limit is None or (isfinite(limit) and limit > 0), 'a number > 0, or None')
        level = self.level_regions
        self._check('level_regions', level is None or 0 <= level <= 1, 'in [0, 1], or None')
        self._check('rounds', isinstance(self.rounds, int) and self.rounds >= 1, 'an integer >= 1')
        self._check('seed_share', 0 <= self.seed_share <= 1, 'a share in [0, 1]')
        self._check('quota', self.quota is None or 0 < self.quota <= 1, 'a share in (0, 1], or None')
        object.__setattr__(self, 'quota_ranges', tuple(self.quota_ranges))
        rising = all(a < b for a, b in zip(self.quota_ranges, self.quota_ranges[1:], strict=False))
        self._check('quota_ranges', rising and all(r >= 0 for r in self.quota_ranges), 'rising metres >= 0')
        self._check('holdout', 0 <= self.holdout < 1, 'a share in [0, 1)')
        self._check('holdout_margin', 0 <= self.holdout_margin <= 1, 'a share in [0, 1]')
        if isinstance(self.centre_distance, list):  # a config file knows no tuples in JSON
            object.__setattr__(self, 'centre_distance', tuple(self.centre_distance))
        distances = self.centre_distance if isinstance(self.centre_distance, tuple) else (self.centre_distance,)
        self._check('centre_distance', all(d is None or d > 0 for d in distances), 'metres > 0, or None')
        switches = [f.name for f in fields(self) if f.name.startswith('use_')]
        for name in (
            *switches,
            'weight_balancing',
            'permanent',
            'new_instances',
            'region_prior',
            'heading',
            'level_looks',
        ):
            self._check(name, isinstance(getattr(self, name), bool), 'True or False')

    def _check(self, name: str, good: bool, expected: str) -> None:
        if not good:
            raise ValueError(f'MergeStrategy.{name}: expected {expected}, got {getattr(self, name)!r}')

    def weights(self, round: int) -> TermWeights:
        """The weights of one round: (1, 1, 1, 0) in round 0, (0, 0, 0, 1) in the last.

        Where the terms that are left would all weigh nothing (the last round without the network's term), a weighted
        mean still has a limit, in which they weigh alike; 'normalised' takes it, a printed sum of nothing stays 0.

        Args:
            round: 0 .. rounds.

        Raises:
            ValueError: The round is outside the schedule.
        """
        if not 0 <= round <= self.rounds:
            raise ValueError(f'MergeStrategy.weights: expected a round in 0..{self.rounds}, got {round}')
        t = round / self.rounds
        geometry, semantics = (1.0 - t, t) if self.weight_balancing else (1.0, 1.0)
        switches = (self.use_color, self.use_scale, self.use_descriptor, self.use_semantics)
        weights = TermWeights(*(y * on for y, on in zip((*[geometry] * 3, semantics), switches, strict=True)))
        if self.thresholds == 'normalised' and not any(weights):
            return TermWeights(*map(float, switches))
        return weights

    def quota_share(self, round: int) -> float:
        """Share of the network-given points that a round may take: ``quota`` in round 1, 1 in the last refresh.

        Args:
            round: 0 .. rounds.
        """
        if self.quota is None:
            return 1.0
        steps = max(self.rounds - 2, 1)  # refreshes after the first; the last has the number rounds - 1
        return self.quota + (1.0 - self.quota) * min(max((round - 1) / steps, 0.0), 1.0)

    def merge_threshold(self) -> float:
        """Condition 3's limit for the value that :attr:`thresholds` compares."""
        return self.tau_merge / 2 if self.thresholds == 'normalised' else self.tau_merge

    def seed_threshold(self) -> float:
        """Condition 4's limit for the value that :attr:`thresholds` compares."""
        return self.tau_seed / 2 if self.thresholds == 'normalised' else self.tau_seed

    def centre_limit(self, classes: Int[np.ndarray, ' regions']) -> Float[np.ndarray, ' regions']:
        """Largest distance to a shifted centre of the same instance, metres, for regions of these classes.

        Args:
            classes: Class of each region; -1 (unknown) is never asked.

        Returns:
            (R,) metres; infinite where the distance is not asked.

        Raises:
            ValueError: ``centre_distance`` is one a class, and has too few of them.
        """
        given = self.centre_distance
        if not isinstance(given, tuple):
            return np.full(len(classes), np.inf if given is None else given)
        if len(classes) and classes.max() >= len(given):
            raise ValueError(
                f'MergeStrategy.centre_distance: {len(given)} numbers (one a class), but a region has class '
                f'{classes.max()}'
            )
        return np.array([*(np.inf if d is None else d for d in given), np.inf])[classes]
