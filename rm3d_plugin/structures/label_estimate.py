"""How good the labels of a round are, as clicks that were left out tell; for the log, the console and the report."""

from collections.abc import Mapping
from typing import Any, NamedTuple

ESTIMATE = 'estimate'  # under which the summary of a round holds the fields of an estimate, or None


class LabelEstimate(NamedTuple):
    """Of the mean IoU on the points that nobody labelled, in percent.

    Attributes:
        miou: Expected.
        low: Lower end of the interval.
        high: Upper end of the interval.
        clicks: Labelled points that were left out in turn.
    """

    miou: float
    low: float
    high: float
    clicks: int

    def text(self) -> str:
        """As a person reads it.

        >>> LabelEstimate(68.2, 60.9, 75.0, 240).text()
        'about 68 (61 to 75) mIoU, from 240 of your clicks'
        """
        return f'about {self.miou:.0f} ({self.low:.0f} to {self.high:.0f}) mIoU, from {self.clicks} of your clicks'


def has_estimate(summary: Mapping[str, Any]) -> bool:
    """Whether a round was checked by left-out clicks, be it that there were too few of them."""
    return ESTIMATE in summary


def estimate_text(summary: Mapping[str, Any]) -> str:
    """The estimate of a round in words, or why there is none.

    Args:
        summary: Of the round; ``estimate`` holds the fields of :class:`LabelEstimate`, or None: too few clicks.

    >>> estimate_text({'estimate': None})
    'no estimate: too few clicks'
    >>> estimate_text({})
    'no estimate: the labels were not checked by left-out clicks'
    """
    if not has_estimate(summary):
        return 'no estimate: the labels were not checked by left-out clicks'
    found = summary[ESTIMATE]
    return 'no estimate: too few clicks' if found is None else LabelEstimate(**found).text()
