"""Gains of the compared methods over labelled data alone, as the paper of RM3D and their own publications have them.

All on SparseConv networks. A gain is told against the baseline of the same table: baselines of different publications
differ by more than methods do.
"""

from typing import NamedTuple

Scores = dict[str, float]


class Pair(NamedTuple):
    """Scores of one publication, in percent: of labelled data alone, and with the method."""

    alone: float
    method: float

    @property
    def gain(self) -> float:
        """Points."""
        return self.method - self.alone


# Key of a table's part -> method -> score; 'labelled_only' is the weak baseline. Tables of the paper of RM3D.
PAPER: dict[str, Scores] = {
    'indoor 0p2pct': {  # mIoU, ScanNet
        'labelled_only': 46.5, 'rm3d': 65.2, 'redal': 63.7, 'psd': 61.5, 'xu_lee': 57.6, 'viewpoint_bottleneck': 55.3,
        'csc': 54.2, 'pointcontrast': 52.3,
    },
    'indoor onept': {
        'labelled_only': 40.1, 'rm3d': 59.6, 'redal': 57.8, 'psd': 54.6, 'xu_lee': 51.3, 'viewpoint_bottleneck': 48.4,
        'csc': 47.7, 'pointcontrast': 45.9,
    },
    'outdoor 0p2pct': {  # mIoU, SemanticKITTI
        'labelled_only': 34.5, 'rm3d': 50.9, 'redal': 48.7, 'psd': 47.6, 'xu_lee': 46.2, 'viewpoint_bottleneck': 44.2,
        'csc': 42.5, 'pointcontrast': 41.1,
    },
    'instances 0p2pct': {  # AP50, ScanNet
        'labelled_only': 35.3, 'rm3d': 55.1, 'redal': 51.6, 'psd': 50.1, 'xu_lee': 47.9, 'viewpoint_bottleneck': 46.6,
        'csc': 43.4, 'pointcontrast': 41.9,
    },
    'detection 1pct': {  # AP of pedestrians, moderate, KITTI
        'labelled_only': 33.2, 'rm3d': 45.3, 'redal': 44.1, 'psd': 43.0, 'xu_lee': 41.9, 'viewpoint_bottleneck': 40.8,
        'csc': 39.7, 'pointcontrast': 38.5,
    },
    'scenes scenes5pct': {  # AP, instances of ScanNet; the row of TWIST is TWIST + CSC there
        'labelled_only': 47.0, 'pointcontrast': 48.5, 'csc': 50.6, 'twist': 58.2, 'rm3d_csc': 58.9,
    },
    'scenes scenes20pct': {
        'labelled_only': 63.0, 'pointcontrast': 63.6, 'csc': 64.1, 'twist': 67.8, 'rm3d_csc': 67.7,
    },
}  # fmt: skip

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
    scores = PAPER.get(part, {})
    return scores[method] - scores['labelled_only'] if method in scores else None


def published_gain(part: str, method: str) -> float | None:
    """Gain of a method in its own publication; None where none is known for such a budget."""
    pair = PUBLICATIONS.get(part, {}).get(method)
    return None if pair is None else pair.gain
