"""What a refresh makes of one scene."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Int

from rm3d_plugin.pseudo_labels.common.assembly import Grouped
from rm3d_plugin.regions import MergeResult
from rm3d_plugin.structures import Boxes3D, PseudoLabels


@dataclass(frozen=True, eq=False)
class RefreshResult:
    """Labels of one scene after a round.

    Attributes:
        labels: What training may read.
        merge: Groups and the ledger.
        stats: Named numbers of this refresh: coverage in [0, 1], counts otherwise.
        candidates: In detection every plausible object with its score, see
            :class:`~rm3d_plugin.pseudo_labels.detection.objects.Objects`.
        steps: In detection, step -> (C,) candidates that it cost, see there.
    """

    labels: PseudoLabels
    merge: MergeResult
    stats: dict[str, float]
    candidates: Boxes3D = Boxes3D.empty()
    steps: dict[str, Int[np.ndarray, ' classes']] = field(default_factory=dict)


def refresh_stats(labels: PseudoLabels, grouped: Grouped) -> dict[str, float]:
    """Named numbers of a refresh, see :class:`RefreshResult`."""
    return {
        'coverage': labels.coverage,
        'annotated_share': float(labels.point_is_annotated.mean()) if len(labels) else 0.0,
        'regions': float(len(grouped.merge.group)),
        'groups': float(len(grouped.groups.classes)),
        'merges': float(grouped.merge.ledger.accepted.sum()),
    }
