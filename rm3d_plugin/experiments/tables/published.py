"""Gains of the compared methods over labelled data alone, as the paper of RM3D and their own publications have them.

All on SparseConv networks. A gain is told against the baseline of the same table: baselines of different publications
differ by more than methods do.
"""

from typing import NamedTuple

from rm3d_plugin.experiments.paper import paper_value


class Pair(NamedTuple):
    """Scores of one publication, in percent: of labelled data alone, and with the method."""

    alone: float
    method: float

    @property
    def gain(self) -> float:
        """Points."""
        return self.method - self.alone


# Key of a table's part -> the paper's table and its column. Rows are methods and a budget, or methods alone.
PAPER = {
    'indoor 0p2pct': 'tablewslresults_sem_indoor:sem_scannet',  # mIoU, as the next two
    'indoor onept': 'tablewslresults_sem_indoor:sem_scannet',
    'outdoor 0p2pct': 'tablewslresults_sem_outdoor:sem_semantickitti',
    'instances 0p2pct': 'tablewslresults_sem_indoor:ins_scannet',  # AP50
    'detection 1pct': 'tablewslresults_det:kitti_moderate',  # AP of pedestrians
    'scenes scenes5pct': 'tab_twist:5pct',  # AP, instances of ScanNet
    'scenes scenes20pct': 'tab_twist:20pct',
}
# Where whole scenes are annotated, the paper's RM3D and TWIST stand with CSC.
WITH_CSC = {'rm3d_csc': 'rm3d', 'rm3d': ''}

# The same of each method's own publication, or of a later one that measured it: the budget nearest to the table's.
PUBLICATIONS: dict[str, dict[str, Pair]] = {
    'indoor 0p2pct': {
        'csc': Pair(62.2, 65.9),  # ScanNet, 100 points a scene (data-efficient benchmark)
        'cpcm': Pair(60.3, 63.8),  # ScanNet, 0.1 % of the points
    },
    'indoor onept': {
        'csc': Pair(41.9, 55.5),  # ScanNet, 20 points a scene
        'cpcm': Pair(37.6, 52.2),  # ScanNet, 0.01 % of the points
    },
    'outdoor 0p2pct': {'gpc': Pair(35.64, 42.45)},  # SemanticKITTI, 5 % of the scans
    'scenes scenes5pct': {'csc': Pair(47.8, 49.8), 'gpc': Pair(49.13, 55.42)},  # mIoU, ScanNet
    'scenes scenes20pct': {'csc': Pair(62.9, 64.6), 'gpc': Pair(64.30, 67.02)},
}


def paper_gain(part: str, method: str) -> float | None:
    """Gain of a method in the paper's table; None where it is not in it."""
    alone, with_it = (_in_paper(part, name) for name in ('labelled_only', method))
    return None if alone is None or with_it is None else with_it - alone


def _in_paper(part: str, method: str) -> float | None:
    table, _, budget = part.partition(' ')
    if table == 'scenes':
        return paper_value(PAPER.get(part, ''), WITH_CSC.get(method, method))
    return paper_value(PAPER.get(part, ''), f'{method} {budget}')


def published_gain(part: str, method: str) -> float | None:
    """Gain of a method in its own publication; None where none is known for such a budget."""
    pair = PUBLICATIONS.get(part, {}).get(method)
    return None if pair is None else pair.gain
