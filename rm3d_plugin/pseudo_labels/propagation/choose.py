"""Which candidate is taken: the default, unless labels that were left out speak clearly for another."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.propagation.rules import DEFAULT, Candidate


class Choice(NamedTuple):
    """What was chosen.

    Attributes:
        candidate: Taken.
        accuracy: Candidate -> share of the left-out labels that it names, all classes counting alike; empty where none
            was left out.
    """

    candidate: Candidate
    accuracy: dict[Candidate, float]


def choose(
    shares: dict[Candidate, Float[np.ndarray, 'left classes']], classes: Int[np.ndarray, ' left'], errors_apart: float
) -> Choice:
    """The best of the candidates that are ahead of the default by so many standard errors, else the default.

    Differences are taken label by label, so that what all candidates find hard does not blur them. The best of several
    on the same labels flatters, hence the margin.

    Args:
        shares: Candidate -> what it says of labels that were left out.
        classes: Of these.
        errors_apart: Larger: other candidates are taken less often.
    """
    counts = np.bincount(classes)
    weight = 1.0 / counts[classes] / np.count_nonzero(counts)
    right = {name: (said.argmax(axis=1) == classes).astype(np.float64) for name, said in shares.items()}
    accuracy = {name: float(weight @ each) for name, each in right.items()}
    best, lead = DEFAULT, 0.0
    for name, each in right.items():
        ahead = accuracy[name] - accuracy[DEFAULT]
        error = float(np.sqrt(np.square(weight * (each - right[DEFAULT])).sum()))
        if ahead > max(lead, errors_apart * error):
            best, lead = name, ahead
    return Choice(best, accuracy)
