"""The part of the report page that tells which merges were sure and which were close."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import NamedTuple

from rm3d_plugin.visualization.report_sections import count, number, section, table

HEAD = (
    'Scene',
    'Regions',
    'True classes',
    'Points',
    'Colour',
    'Scale',
    'Normals',
    'Descriptor',
    'Semantics',
    'Compared',
    'Needed',
)


class MergeRow(NamedTuple):
    """One pair of adjacent regions. Similarities lie in [0, 1]; NaN where a term was missing.

    Attributes:
        scene: Name.
        regions: Numbers of both.
        true_classes: Most frequent true class of each, '' = not known; they were never used.
        points: Of each.
        color: M_color.
        scale: M_scale.
        normals: A_n, a part of M_des.
        descriptor: A_des, the other part.
        semantics: M_seg.
        compared: What was compared with ``needed``: the mean of the terms, or their sum (literal thresholds).
        needed: Threshold.
    """

    scene: str
    regions: tuple[int, int]
    true_classes: tuple[str, str]
    points: tuple[int, int]
    color: float
    scale: float
    normals: float
    descriptor: float
    semantics: float
    compared: float
    needed: float

    @property
    def margin(self) -> float:
        """How far above the threshold the pair was."""
        return self.compared - self.needed


@dataclass(frozen=True)
class MergeReport:
    """What became of the pairs of adjacent regions in one round.

    Attributes:
        round: Its number.
        pairs: Adjacent pairs over all scenes.
        fates: In words, with how many pairs each.
        tables: 'Strongest merges', 'Weakest merges', 'Closest refusals'.
    """

    round: int
    pairs: int
    fates: Mapping[str, int] = field(default_factory=dict)
    tables: Mapping[str, Sequence[MergeRow]] = field(default_factory=dict)


def merge_section(merges: MergeReport) -> str:
    """Counts in a sentence, then the tables."""
    fates = '; '.join(f'{count(found)} {escape(words)}' for words, found in merges.fates.items() if found)
    words = f'<p>Round {merges.round}: of {count(merges.pairs)} pairs of adjacent regions {fates}.</p>'
    tables = [table(HEAD, [_cells(row) for row in rows], name, 3) for name, rows in merges.tables.items() if rows]
    return section('merges', 'Merges', words + ''.join(tables))


def _cells(row: MergeRow) -> list[str]:
    first, second = (name or 'not known' for name in row.true_classes)
    classes = first if first == second else f'{first} | {second}'
    terms = (row.color, row.scale, row.normals, row.descriptor, row.semantics)
    return [
        escape(row.scene),
        ' + '.join(map(str, row.regions)),
        escape(classes),
        ' + '.join(map(count, row.points)),
        *map(number, terms),
        number(row.compared, 3),
        number(row.needed, 3),
    ]
