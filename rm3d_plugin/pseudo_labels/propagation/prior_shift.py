"""How frequent classes are where labels do not say so: as many labels of each class were given, or a chance draw."""

import numpy as np
from jaxtyping import Float, Int

TRUST = 50.0  # labels that the solution's frequencies count against one pseudo label of the labels' own


def prior_shift(
    said: Int[np.ndarray, ' nodes'],
    sizes: Int[np.ndarray, ' nodes'],
    places: Int[np.ndarray, ' classes'],
    half: float,
    counts: Int[np.ndarray, ' classes'] | None = None,
) -> Float[np.ndarray, ' classes']:
    """Factors that turn shares by labels as they were given into shares by classes as they are.

    The frequency of each class in a solution over its frequency among the labels (Saerens, Latinne and Decaestecker
    2002; one step from a solution that knows more than the classifier). A chance draw has factors near 1, as many
    labels of each class have large factors for frequent classes. A step too far empties rare classes, the more so the
    less the labels tell: the exponent is their :func:`label_trust`; with one label a class nothing changes.

    Args:
        said: Class of each node in a solution.
        sizes: Points of each node.
        places: Labels of each class, those of one place once; at least one.
        half: See :func:`label_trust`.
        counts: Labels of each class, each once; None: as many. Strokes have far more labels than places, dense chance
            draws fall together into few places: the count that is nearer to the solution is taken.

    >>> prior_shift(np.array([0, 0, 0, 1]), np.ones(4, int), np.array([1, 1]), 3.0)
    array([1., 1.])
    >>> prior_shift(np.array([0, 0, 0, 1]), np.ones(4, int), np.array([30, 10]), 3.0).round(1)
    array([1., 1.])
    """
    share = np.bincount(said, sizes, len(places)) / max(float(sizes.sum()), 1.0)
    factors, apart = [], []
    for each in (places,) if counts is None else (places, counts):
        given = (each + 1) / (each.sum() + len(each))
        found = (share * each.sum() * TRUST + given) / (each.sum() * TRUST + 1)
        factors.append(found / given)
        apart.append(float(found @ np.log(found / given)))
    return np.asarray(factors[int(np.argmin(apart))] ** label_trust(places, half))


def label_trust(counts: Int[np.ndarray, ' classes'], half: float) -> float:
    """How far labels are to be trusted to tell of classes as a whole: 0 with one a class, towards 1 with many.

    (n - 1) / (n + half - 2) with n the harmonic mean of the labels a class, which the class with the fewest rules.

    Args:
        counts: Labels of each class, at least one.
        half: Labels a class at which it is near one half.

    >>> round(label_trust(np.array([20, 20]), 3.0), 2)
    0.9
    """
    if not len(counts):
        return 0.0
    mean = float(1.0 / np.mean(1.0 / counts))
    return (mean - 1.0) / (mean + half - 2.0)
