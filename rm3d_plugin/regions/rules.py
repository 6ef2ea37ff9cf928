"""How regions merge: thresholds, terms and the schedule of the weights (METHOD 6)."""

from dataclasses import dataclass
from math import isfinite
from typing import Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.structures.check_field import check_choice, check_field, check_positive, check_switches

Thresholds = Literal['normalised', 'literal']
Pooling = Literal['mean', 'max']
Term = Literal['color', 'scale', 'descriptor', 'semantics']
TERMS: tuple[Term, ...] = get_args(Term)


class TermWeights(NamedTuple):
    """The weights y1..y4 of S; zero for a term that is left out."""

    color: float
    scale: float
    descriptor: float
    semantics: float


@dataclass(frozen=True)
class MergeRules:
    """Every number of the merging step; the defaults are the paper's, made to work.

    S is a weighted sum of four similarities whose weights move from geometry to semantics. Printed thresholds on the
    sum cannot be reached late in the schedule (Condition 4 for t > .75, Condition 3 for t > .875), so the default
    compares the weighted *mean* with half of each threshold, which is the same at t = 1/2; ``thresholds='literal'``
    keeps the printed rule.

    Attributes:
        tau_merge: Condition 3, S from which two regions merge (a sum, as printed); larger: fewer merges.
        tau_seed: Condition 4, S from which a merged region lets the group grow on; larger: shorter chains.
        thresholds: 'normalised' compares S / sum(y) with tau / 2, 'literal' compares S with tau.
        gamma: Softmax from which a region is confident; larger: fewer and purer labels.
        without: Terms of S that are left out: 'color' (of a lidar: intensity), 'scale', 'descriptor', 'semantics'.
        lambda_seg: Steepness of the semantic similarity exp(-lambda |p - q|^2).
        lambda_normal: Weight of the normals in the affinity (Condition 1 and the descriptor term); 0: left out.
        lambda_descriptor: Weight of the descriptors in the affinity; 0: left out.
        weight_balancing: False gives every term the weight 1 in every round.
        rounds: Rounds in which the weights go from (1, 1, 1, 0) to (0, 0, 0, 1).
        pooling: 'mean' of the points' softmax over a region, or their 'max' per class, renormalised (as printed).
        color_sigma: Lab distance at which the colour similarity is exp(-1/2).
        intensity_sigma: The same for a lidar's return strength in [0, 1].
        centre_distance: Regions of one class are one instance if their shifted centres are nearer than this (metres);
            one number for all classes, one a class (None: not asked for that class), or None: never asked.
        seed_share: Share of the regions, flattest first, that are seeds beside the annotated ones.
        demote_margin: A label falls when its class's pooled probability is under ``gamma - demote_margin`` (METHOD 1:
            .15). None: a label once given stays.

    Raises:
        ValueError: A value is out of its range; the message names the field.
    """

    tau_merge: float = 1.25
    tau_seed: float = 1.5
    thresholds: Thresholds = 'normalised'
    gamma: float = 0.75
    without: tuple[Term, ...] = ()
    lambda_seg: float = 2.0
    lambda_normal: float = 1.0
    lambda_descriptor: float = 1.0
    weight_balancing: bool = True
    rounds: int = 8
    pooling: Pooling = 'mean'
    color_sigma: float = 15.0
    intensity_sigma: float = 0.1
    centre_distance: float | tuple[float | None, ...] | None = None
    seed_share: float = 0.002
    demote_margin: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, 'without', tuple(self.without))
        if isinstance(self.centre_distance, list):  # a config file knows no tuples in JSON
            object.__setattr__(self, 'centre_distance', tuple(self.centre_distance))
        for name in ('tau_merge', 'tau_seed'):
            check_field(self, name, 0 <= getattr(self, name) <= 4, 'a sum of four similarities, in [0, 4]')
        check_field(self, 'tau_seed', self.tau_seed >= self.tau_merge, f'at least tau_merge = {self.tau_merge}')
        check_choice(self, 'thresholds', get_args(Thresholds))
        check_choice(self, 'pooling', get_args(Pooling))
        check_field(self, 'without', set(self.without) <= set(TERMS), f'a list of some of {TERMS}')
        check_field(self, 'gamma', 0 < self.gamma <= 1, 'a probability in (0, 1]')
        for name in ('lambda_seg', 'lambda_normal', 'lambda_descriptor'):
            check_field(self, name, isfinite(getattr(self, name)) and getattr(self, name) >= 0, 'a number >= 0')
        check_switches(self, 'weight_balancing')
        check_field(self, 'rounds', isinstance(self.rounds, int) and self.rounds >= 1, 'an integer >= 1')
        check_positive(self, 'color_sigma', 'intensity_sigma')
        distances = self.centre_distance if isinstance(self.centre_distance, tuple) else (self.centre_distance,)
        check_field(self, 'centre_distance', all(d is None or d > 0 for d in distances), 'metres > 0, or None')
        check_field(self, 'seed_share', 0 <= self.seed_share <= 1, 'a share in [0, 1]')
        margin = self.demote_margin
        check_field(self, 'demote_margin', margin is None or 0 <= margin <= self.gamma, 'in [0, gamma], or None')

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
            raise ValueError(f'MergeRules.weights: expected a round in 0..{self.rounds}, got {round}')
        t = round / self.rounds
        geometry, semantics = (1.0 - t, t) if self.weight_balancing else (1.0, 1.0)
        kept = [term not in self.without for term in TERMS]
        weights = TermWeights(*(y * on for y, on in zip((*[geometry] * 3, semantics), kept, strict=True)))
        if self.thresholds == 'normalised' and not any(weights):
            return TermWeights(*map(float, kept))
        return weights

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
                f'MergeRules.centre_distance: {len(given)} numbers (one a class), but a region has class '
                f'{classes.max()}'
            )
        return np.array([*(np.inf if d is None else d for d in given), np.inf])[classes]
