"""Deciding the merges of a round again with other thresholds, from what its ledger kept; nothing is trained."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from functools import reduce
from operator import add
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int
from mmengine.registry import init_default_scope

from rm3d_plugin.datasets.base import DatasetNotFoundError
from rm3d_plugin.engine.config import ConfigError, read_settings
from rm3d_plugin.labeling.sources import LabelSource
from rm3d_plugin.ops.segment import segment_values
from rm3d_plugin.pseudo_labels.common.assembly import (
    Grouped,
    keep_previous,
    labels_of_groups,
    limit_new_labels,
    supported_points,
)
from rm3d_plugin.pseudo_labels.common.groups import without_doubtful
from rm3d_plugin.pseudo_labels.common.inputs import RoundContext
from rm3d_plugin.pseudo_labels.common.ledger import extreme_merges, sentence
from rm3d_plugin.pseudo_labels.common.record import RefreshRecord
from rm3d_plugin.pseudo_labels.common.self_training import SelfTrainingRules
from rm3d_plugin.regions import MergeLedger, MergeResult, MergeRules
from rm3d_plugin.regions.merge import decide
from rm3d_plugin.regions.similarity import PairTerms
from rm3d_plugin.registry import SCOPE, TASK_UTILS
from rm3d_plugin.storage import LabelStore
from rm3d_plugin.structures import PseudoLabels, SceneError

FIXED = ('pooling', 'color_sigma', 'intensity_sigma')
"""Rules of merging whose values went into the ledger before it was written; another value needs another run."""
LIMITS = ('cbst_fraction', 'cbst_ranges')
"""Rules of self-training that can be replayed."""


class ReplayRules(NamedTuple):
    """Rules that decide the merges of a round again.

    Attributes:
        merge: Thresholds and terms.
        self_training: How new labels are limited, or None.
    """

    merge: MergeRules
    self_training: SelfTrainingRules | None = None

    @classmethod
    def of(cls, record: RefreshRecord) -> 'ReplayRules':
        """Those of the run."""
        return cls(record.merge, record.self_training)


class Decided(NamedTuple):
    """What rules make of a scene."""

    merge: MergeResult
    semantic: Int[np.ndarray, ' points']


@dataclass(frozen=True)
class ReplayCounts:
    """Points, pairs and groups of one or several scenes; before / after. They add up.

    Attributes:
        points: Points.
        labels_changed: Points that have another label after.
        pairs: Adjacent pairs of regions.
        merges: Accepted pairs.
        merges_changed: Pairs that are in one group before or after, but not both.
        groups: Groups of regions.
        labelled: Points with a label.
        compared: Points with a pseudo label whose truth is known.
        correct: Those of them whose label is correct.
    """

    points: int
    labels_changed: int
    pairs: int
    merges_changed: int
    merges: tuple[int, int]
    groups: tuple[int, int]
    labelled: tuple[int, int]
    compared: tuple[int, int]
    correct: tuple[int, int]

    def __add__(self, other: 'ReplayCounts') -> 'ReplayCounts':
        sums: dict[str, Any] = {}
        for item in fields(self):
            a, b = getattr(self, item.name), getattr(other, item.name)
            sums[item.name] = tuple(map(add, a, b)) if isinstance(a, tuple) else a + b
        return ReplayCounts(**sums)


def changed_rules(rules: ReplayRules, changes: Mapping[str, Any]) -> ReplayRules:
    """The rules with other values.

    Args:
        rules: Those of the run.
        changes: Fields of :class:`MergeRules`, ``cbst_fraction`` and ``cbst_ranges``, and ``tau``: what the compared
            value must reach (the mean in 'normalised', the sum in 'literal'); ``tau_seed`` rises with it where it would
            be lower.

    Raises:
        ConfigError: A name or value that cannot be replayed.
    """
    given = dict(changes)
    known = [item.name for item in fields(MergeRules) if item.name not in FIXED]
    if bad := [name for name in given if name not in (*known, *LIMITS, 'tau')]:
        why = 'is decided before the ledger is written; train anew' if bad[0] in FIXED else 'is no threshold or switch'
        raise ConfigError(f'--replay {bad[0]}: {why}. Expected any of tau, {", ".join((*known, *LIMITS))}')
    limits = {name: given.pop(name) for name in LIMITS if name in given}
    tau = given.pop('tau', None)
    try:
        if tau is not None:
            mode = given.get('thresholds', rules.merge.thresholds)
            given['tau_merge'] = 2 * float(tau) if mode == 'normalised' else float(tau)
            given.setdefault('tau_seed', max(rules.merge.tau_seed, given['tau_merge']))
        merge = replace(rules.merge, **given)
        return ReplayRules(merge, replace(rules.self_training or SelfTrainingRules(), **limits))
    except (TypeError, ValueError) as error:
        raise ConfigError(f'--replay: {error}') from error


def decide_again(
    ledger: MergeLedger, stored: PseudoLabels, previous: PseudoLabels | None, rules: ReplayRules | None = None
) -> Decided:
    """Merge and label a scene from its ledger alone.

    With the rules of the run (None) the result is what the run had; in detection, what it had before boxes were fitted,
    and without the parts that were cut out of regions.

    Args:
        ledger: Of the round, with its record.
        stored: Labels of the round; their annotated ones stay.
        previous: Labels of the round before, or None.
        rules: Others than those of the run.

    Raises:
        ValueError: The ledger has no record.
    """
    record = RefreshRecord.from_arrays(ledger.known)
    rules = rules or ReplayRules.of(record)
    terms = PairTerms(ledger.M_color, ledger.M_scale, ledger.A_n, ledger.A_des)
    edges = np.stack([ledger.region_a, ledger.region_b], axis=1)
    result = decide(edges, terms, record.curvatures, record.evidence(), rules.merge, record.round)
    groups = record.label(result.group, rules.merge.gamma)
    if record.class_gamma is not None:
        groups = without_doubtful(groups, record.class_gamma)
    points = segment_values(result.group, record.point_region, -1)
    ranges = segment_values(record.ranges, record.point_region, 0.0)
    grouped = Grouped(result, groups, points, ranges, record)
    grouped = limit_new_labels(grouped, RoundContext(record.round, rules, record.class_counts))
    labels = keep_previous(labels_of_groups(grouped), previous, supported_points(previous, grouped, rules.merge))
    if record.named is not None:
        named = segment_values(record.named, record.point_region, False)
        labels = labels.overlay(named, stored.semantic, labels.confidence)
    labels = labels.overlay(stored.point_is_annotated, stored.semantic, 1.0)
    return Decided(result, labels.semantic)


def compare(
    before: Decided, after: Decided, stored: PseudoLabels, truth: Int[np.ndarray, ' points'] | None
) -> ReplayCounts:
    """What changed, and whether for the better.

    Args:
        before: With the rules of the run.
        after: With another.
        stored: Labels of the round, which name the annotated points; those are not compared.
        truth: True class of each point, -1 = not known; or None.
    """
    ledgers = (before.merge.ledger, after.merge.ledger)
    both = [d.merge.group[np.stack([d.merge.ledger.region_a, d.merge.ledger.region_b])] for d in (before, after)]
    joined = [pair[0] == pair[1] for pair in both]
    known = np.zeros(len(stored), dtype=bool) if truth is None else (truth >= 0) & ~stored.point_is_annotated
    compared = [known & (d.semantic >= 0) for d in (before, after)]
    pairwise = zip((before, after), compared, strict=True)
    correct = [0 if truth is None else int((d.semantic == truth)[j].sum()) for d, j in pairwise]
    return ReplayCounts(
        points=len(stored),
        labels_changed=int((before.semantic != after.semantic).sum()),
        pairs=len(ledgers[0]),
        merges_changed=int((joined[0] != joined[1]).sum()),
        merges=(int(ledgers[0].accepted.sum()), int(ledgers[1].accepted.sum())),
        groups=(int(before.merge.group.max(initial=-1)) + 1, int(after.merge.group.max(initial=-1)) + 1),
        labelled=(int((before.semantic >= 0).sum()), int((after.semantic >= 0).sum())),
        compared=(int(compared[0].sum()), int(compared[1].sum())),
        correct=(correct[0], correct[1]),
    )


class RoundOfLabels:
    """The labels and ledgers of one round of a run, and the truth where it can be had.

    Args:
        labels: Folder of the label store.
        round: Which round; None: the one that training reads.
        scene: Only this scene; None: all.
        source: Gives the truth, for numbers on the screen only; or None.

    Raises:
        SceneError: There is no such round or scene, or it has no ledger.
    """

    def __init__(
        self,
        labels: str | Path,
        round: int | None = None,
        scene: str | None = None,
        source: LabelSource | None = None,
    ) -> None:
        self.store = LabelStore(labels)
        self.round = self.store.current_round() if round is None else round
        found = tuple(self.store.scenes(self.round))
        if scene is not None and scene not in found:
            raise SceneError(f'--scene {scene}: round {self.round} of {labels} has {", ".join(found[:5])} ...')
        self.scenes = [s for s in (found if scene is None else (scene,)) if self._has_ledger(s)]
        if not self.scenes:
            raise SceneError(f'{labels}: round {self.round} has no ledger; labels that never merged cannot be replayed')
        self._source = source

    def _has_ledger(self, scene: str) -> bool:
        assert self.round is not None
        return self.store.ledger_path(self.round, scene).is_file()

    def ledgers(self) -> Iterator[tuple[str, MergeLedger]]:
        """Scene and ledger, one after the other."""
        for scene in self.scenes:
            try:
                yield scene, MergeLedger.from_arrays(self.store.read_ledger(scene, self.round))
            except ValueError as error:
                raise SceneError(f'scene {scene}, round {self.round}: {error}') from error

    def replay(self, changes: Mapping[str, Any]) -> dict[str, ReplayCounts]:
        """Decide every scene again with changed thresholds; see :func:`changed_rules`."""
        assert self.round is not None
        out = {}
        for scene, ledger in self.ledgers():
            stored = self.store.read(scene, self.round)
            previous = self.store.read(scene, self.round - 1) if self.round else None
            if not ledger.known:
                raise SceneError(f'scene {scene}, round {self.round}: the ledger holds no record to replay')
            rules = changed_rules(ReplayRules.of(RefreshRecord.from_arrays(ledger.known)), changes)
            before = decide_again(ledger, stored, previous)
            after = decide_again(ledger, stored, previous, rules)
            out[scene] = compare(before, after, stored, self._truth(scene, len(stored)))
        return out

    def _truth(self, scene: str, points: int) -> Int[np.ndarray, ' points'] | None:
        if self._source is None or scene not in self._source.scene_ids:
            return None
        truth = self._source.truth(list(self._source.scene_ids).index(scene))
        if truth is None or truth.semantic is None:
            return None
        if len(truth.semantic) != points:
            raise SceneError(f'scene {scene}: {len(truth.semantic)} true labels for {points} points; the data changed')
        return truth.semantic


def source_of_run(labels: str | Path, config: str | Path | None = None) -> tuple[LabelSource | None, str]:
    """Where the truth of a run's scenes may be had, and if nowhere, why.

    Args:
        labels: Folder of the label store, in the run's work directory.
        config: The run's config; None: the one that the run left beside its labels.

    Raises:
        ConfigError: The given config does not exist.
    """
    if config is not None and not Path(config).is_file():
        raise ConfigError(f'--config {config}: no such file')
    left = sorted(Path(labels).resolve().parent.glob('*.py')) if config is None else [Path(config)]
    if len(left) != 1:
        return None, f'{len(left)} configs beside {labels}; name one with --config'
    settings = read_settings(left[0])
    hooks = [hook for hook in settings.get('custom_hooks', []) if 'RegionMergeHook' in hook.type]
    if not hooks:
        return None, f'{left[0]} makes no labels'
    init_default_scope(SCOPE)
    source: LabelSource
    try:
        source = TASK_UTILS.build(hooks[0].label_maker.source)
        source.scene_ids  # noqa: B018  looks for the data
    except DatasetNotFoundError as error:
        return None, str(error).splitlines()[0]
    return source, ''


def format_replay(scenes: Mapping[str, ReplayCounts], changes: Mapping[str, Any], limit: int = 20) -> str:
    """A line for each scene, those that change most first, and one for all."""
    ranked = sorted(scenes, key=lambda name: (-scenes[name].labels_changed, name))
    total = reduce(add, scenes.values())
    lines = [_line(name, scenes[name]) for name in ranked[:limit]]
    if len(ranked) > limit:
        lines.append(f'... {len(ranked) - limit} more scenes, which change less')
    asked = ' '.join(f'{name}={value}' for name, value in changes.items())
    return '\n'.join([f'replay of {len(scenes)} scenes with {asked} (before -> after)', *lines, _line('all', total)])


def _line(name: str, counts: ReplayCounts) -> str:
    n = max(counts.points, 1)
    coverage = ' -> '.join(f'{100 * part / n:.2f}' for part in counts.labelled)
    text = (
        f'{name}: merges {counts.merges[0]} -> {counts.merges[1]} ({counts.merges_changed} of {counts.pairs} pairs '
        f'changed), groups {counts.groups[0]} -> {counts.groups[1]}, labels of {counts.labels_changed} of '
        f'{counts.points} points changed, coverage {coverage} %'
    )
    if not any(counts.compared):
        return text
    shares = [f'{100 * r / j:.2f}' if j else '-' for r, j in zip(counts.correct, counts.compared, strict=True)]
    return f'{text}, precision {" -> ".join(shares)} %'


def format_extremes(round_: RoundOfLabels, count: int) -> str:
    """The strongest and weakest merges and the closest refusals over all scenes, in words."""
    kinds: dict[str, list[tuple[float, str]]] = {'strongest merges': [], 'weakest merges': [], 'closest refusals': []}
    for scene, ledger in round_.ledgers():
        found = extreme_merges(ledger, count)
        for kind, rows in zip(kinds, (found.strongest, found.weakest, found.refused), strict=True):
            kinds[kind] += [(float(found.margin[row]), f'{scene}: {sentence(ledger, int(row))}') for row in rows]
    blocks = []
    for kind, entries in kinds.items():
        best = sorted(entries, key=lambda e: e[0] if kind == 'weakest merges' else -e[0])[:count]
        blocks.append('\n'.join([f'{kind}:', *(f'  {text}' for _, text in best)] if best else [f'{kind}: none']))
    return '\n'.join(blocks)
