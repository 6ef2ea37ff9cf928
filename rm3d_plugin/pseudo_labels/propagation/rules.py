"""Settings of the propagation of few labels over a scan."""

from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

Candidate = Literal['walker and features', 'walker', 'nearest', 'nearest in place and colour']
DEFAULT: Candidate = 'walker and features'
CANDIDATES: tuple[Candidate, ...] = get_args(Candidate)


class NetworkSay(NamedTuple):
    """How a network enters an answer.

    Attributes:
        weight: Power of its probabilities; 0: no say.
        own: Power of those of the walk beside it. Both together are about as sure as the walk alone;
            judged by few labels they claim too much.
        labels: That judged it.
    """

    weight: float
    own: float
    labels: int


SILENT = NetworkSay(0.0, 1.0, 0)


@dataclass(frozen=True)
class WalkerRules:
    """How labels spread; no length, angle or colour is among it, since those are measured in each scan.

    The strengths were chosen on eight Oakland tiles (part2), three SemanticKITTI scans (00) and six synthetic rooms.

    Attributes:
        nodes: Without a label of each graph that is solved, at most (larger: sharper borders between classes, slower).
        left_out_nodes: The same where labels are left out (larger: nearer to what is taken in the end, slower).
        features_strength: Pull of the features where there is one label a class, as a share of the usual sum of
            a point's edges (larger: features count more than how near a label lies over the surface).
        taught_strength: The same where many labels teach the features; between the two by
            :func:`~rm3d_plugin.pseudo_labels.propagation.prior_shift.label_trust`.
        steps: Conjugate gradients at the points in the end (larger: nearer to a solve at every point, slower).
        prior_rounds: Times that the frequency of the classes is read off the solution and put into it.
        prior_half: Labels a class from which on frequencies and features are trusted by half and more.
        folds: Parts into which the labels are divided to be left out; 0: nothing is left out.
        least_left_out: Labels, one a place, that can be left out without taking a class away, below which none is.
        errors_apart: Standard errors by which another candidate must be ahead of the default.
        network_errors_apart: The same for the log likelihood of labels with a network beside that without.
        examples: Labels of a class that teach its features, at most.
        draws: Of the interval of the estimate.
        seed: Of folds and draws.
    """

    nodes: int = 12000
    left_out_nodes: int = 8000
    features_strength: float = 0.0003
    taught_strength: float = 0.006
    steps: int = 10
    prior_rounds: int = 2
    prior_half: float = 3.0
    folds: int = 5
    least_left_out: int = 10
    errors_apart: float = 3.0
    network_errors_apart: float = 2.0
    examples: int = 200
    draws: int = 200
    seed: int = 0
