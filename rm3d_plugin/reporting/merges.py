"""The surest and the closest decisions of a round's merging, read from its ledgers."""

from collections import Counter
from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from rm3d_plugin.labeling.sources import LabelSource
from rm3d_plugin.pseudo_labels.common.ledger import compared_value, extreme_merges, summarise
from rm3d_plugin.pseudo_labels.common.record import RefreshRecord
from rm3d_plugin.regions import MergeLedger, Reason
from rm3d_plugin.reporting.replay import RoundOfLabels
from rm3d_plugin.storage import LabelStore
from rm3d_plugin.structures import UNLABELLED
from rm3d_plugin.visualization.report_merges import MergeReport, MergeRow

_FATES = {
    Reason.MERGED: 'merged',
    Reason.SAME_GROUP: 'ended in one group by way of other pairs',
    Reason.NOT_CONFIDENT: 'are not both confident',
    Reason.OTHER_CLASS: 'have different classes',
    Reason.NOT_SIMILAR: 'are not similar enough',
    Reason.CENTRES_APART: 'have shifted centres too far from each other',
    Reason.OTHER_INSTANCE: 'belong to two true instances',
    Reason.NOT_REACHED: 'were fit to merge, but no seed led there',
}
_TABLES = ('Strongest merges', 'Weakest merges', 'Closest refusals')


def merge_report(store: LabelStore, source: LabelSource, count: int = 8) -> MergeReport | None:
    """Of the last round that has ledgers: how many pairs merged, and the extremes; None where nothing ever merged.

    Args:
        store: Labels of the run.
        source: Gives the classes and the truth of the shown pairs.
        count: Rows of each table.
    """
    merged = [n for n in store.rounds() if any(store.ledger_path(n, scene).is_file() for scene in store.scenes(n))]
    if not merged:
        return None
    pairs, fates = 0, Counter[str]()
    tables: dict[str, list[MergeRow]] = {name: [] for name in _TABLES}
    index_of = {scene: index for index, scene in enumerate(source.scene_ids)}
    for scene, ledger in RoundOfLabels(store.root, merged[-1]).ledgers():
        summary = summarise(ledger)
        pairs += summary.pairs
        fates.update(summary.reasons)
        found = extreme_merges(ledger, count)
        truth = source.truth(index_of[scene]) if scene in index_of else None
        members = _Regions(ledger, None if truth is None else truth.semantic, source.classes)
        for name, rows in zip(_TABLES, (found.strongest, found.weakest, found.refused), strict=True):
            tables[name] = _best(tables[name] + [members.row(scene, int(row)) for row in rows], name, count)
    return MergeReport(merged[-1], pairs, {_FATES[r]: fates[r.name] for r in _FATES}, tables)


def _best(rows: list[MergeRow], name: str, count: int) -> list[MergeRow]:
    return sorted(rows, key=lambda row: row.margin if name == 'Weakest merges' else -row.margin)[:count]


class _Regions:
    """What the rows of a ledger tell of their regions, with size and truth of these where the ledger has a record."""

    def __init__(self, ledger: MergeLedger, truth: Int[np.ndarray, ' points'] | None, classes: Sequence[str]) -> None:
        self.ledger, self.classes = ledger, classes
        self.compared = compared_value(ledger)
        self.region = RefreshRecord.from_arrays(ledger.known).point_region if ledger.known else None
        fits = truth is not None and self.region is not None and len(truth) == len(self.region)
        self.truth = truth if fits else None

    def row(self, scene: str, row: int) -> MergeRow:
        """One line of a table."""
        ledger = self.ledger
        pair = int(ledger.region_a[row]), int(ledger.region_b[row])
        sizes = tuple(0 if self.region is None else int((self.region == r).sum()) for r in pair)
        names = tuple(self._true_class(r) for r in pair)
        return MergeRow(
            scene,
            pair,
            (names[0], names[1]),
            (sizes[0], sizes[1]),
            color=float(ledger.M_color[row]),
            scale=float(ledger.M_scale[row]),
            normals=float(ledger.A_n[row]),
            descriptor=float(ledger.A_des[row]),
            semantics=float(ledger.M_seg[row]),
            compared=float(self.compared[row]),
            needed=float(ledger.threshold[row]),
        )

    def _true_class(self, region: int) -> str:
        if self.truth is None:
            return ''
        inside = self.truth[self.region == region]
        inside = inside[inside != UNLABELLED]
        return self.classes[int(np.bincount(inside).argmax())] if len(inside) else ''
