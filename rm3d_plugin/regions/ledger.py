"""What was decided about each pair of adjacent regions, and why. It is for reading: no round goes on from one."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from enum import IntEnum

import numpy as np
from jaxtyping import Bool, Float, Int

KNOWN = 'known.'
FORMAT = 2  # of the file; raise it when names or meanings change, so that older files are refused


class Reason(IntEnum):
    """Why a pair was accepted or refused; the first that applies in this order."""

    MERGED = 0
    NOT_CONFIDENT = 1
    OTHER_CLASS = 2
    NOT_SIMILAR = 3
    CENTRES_APART = 4
    OTHER_INSTANCE = 5
    NOT_REACHED = 6  # fit to merge, but no seed led there: both ends were settled before
    SAME_GROUP = 7  # joined by other pairs


@dataclass(frozen=True, eq=False)
class MergeLedger:
    """One row for each edge of the region graph, in the graph's order.

    Attributes:
        region_a: (E,) int64 lower region.
        region_b: (E,) int64 higher region.
        M_color: (E,) similarity of colour in [0, 1], NaN where missing; as the next three.
        M_scale: (E,) similarity of extents.
        M_des: (E,) affinity of normals and descriptors.
        M_seg: (E,) similarity of the network's softmax.
        A_n: (E,) |cosine| of the mean normals, a part of M_des.
        A_des: (E,) cosine of the mean descriptors, the other part.
        S: (E,) weighted sum of the terms.
        Sbar: (E,) S over the sum of the weights.
        threshold: (E,) what S (literal) or Sbar (normalised) had to reach.
        accepted: (E,) bool, this pair joined two groups.
        became_seed: (E,) bool, the region that joined let its group grow on (Condition 4).
        round: (E,) int64.
        reason: (E,) int64 :class:`Reason`.
        known: What the decisions were made from, by name, where the writer keeps it (see
            :class:`~rm3d_plugin.pseudo_labels.common.record.RefreshRecord`); needed to replay a round.
    """

    region_a: Int[np.ndarray, ' edges']
    region_b: Int[np.ndarray, ' edges']
    M_color: Float[np.ndarray, ' edges']
    M_scale: Float[np.ndarray, ' edges']
    M_des: Float[np.ndarray, ' edges']
    M_seg: Float[np.ndarray, ' edges']
    A_n: Float[np.ndarray, ' edges']
    A_des: Float[np.ndarray, ' edges']
    S: Float[np.ndarray, ' edges']
    Sbar: Float[np.ndarray, ' edges']
    threshold: Float[np.ndarray, ' edges']
    accepted: Bool[np.ndarray, ' edges']
    became_seed: Bool[np.ndarray, ' edges']
    round: Int[np.ndarray, ' edges']
    reason: Int[np.ndarray, ' edges']
    known: Mapping[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, column in self.columns().items():
            if len(column) != len(self.region_a):
                raise ValueError(f'MergeLedger.{name}: expected {len(self.region_a)} rows, got {len(column)}')

    def __len__(self) -> int:
        return len(self.region_a)

    def columns(self) -> dict[str, np.ndarray]:
        """One array for each column, by name."""
        return {name: getattr(self, name) for name in _names()}

    def select(self, rows: np.ndarray) -> 'MergeLedger':
        """The rows that ``rows`` (integers or a boolean mask) names; ``ledger.select(ledger.accepted)``, say."""
        return MergeLedger(**{name: column[rows] for name, column in self.columns().items()})

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Columns by name, what is known under ``known.NAME``, and the format, for an npz file."""
        known = {f'{KNOWN}{name}': value for name, value in self.known.items()}
        return {'format': np.array(FORMAT)} | self.columns() | known

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> 'MergeLedger':
        """The inverse of :meth:`to_arrays`; other columns are ignored.

        Raises:
            ValueError: The format is another, or a column is missing.
        """
        found = int(arrays.get('format', 1))
        if found != FORMAT:
            raise ValueError(
                f'MergeLedger: the file has format {found}, this version reads {FORMAT}; '
                'make the labels of that run again, or read them with the version that wrote them'
            )
        names = _names()
        missing = [name for name in names if name not in arrays]
        if missing:
            raise ValueError(f'MergeLedger: columns {missing} are missing; the file is not a ledger')
        known = {name.removeprefix(KNOWN): array for name, array in arrays.items() if name.startswith(KNOWN)}
        return cls(**{name: np.asarray(arrays[name]) for name in names}, known=known)


def _names() -> list[str]:
    return [column.name for column in fields(MergeLedger) if column.name != 'known']
