"""The l0 energy, and its minimum over a chain by trying every set of cuts."""

import itertools

import numpy as np


def energy(features, edges, weights, labels):
    """Sum |x - f|^2 + sum w [x_i != x_j] with the mean of each part as x."""
    fit = sum(
        float(((features[labels == part] - features[labels == part].mean(axis=0)) ** 2).sum())
        for part in np.unique(labels)
    )
    return fit + float(weights[labels[edges[:, 0]] != labels[edges[:, 1]]].sum())


def best_chain(features, weights):
    """Least energy of a chain of points, and its labels."""
    edges = np.stack([np.arange(len(features) - 1), np.arange(1, len(features))], axis=1)
    every = itertools.product([0, 1], repeat=len(edges))
    options = (np.concatenate([[0], np.cumsum(cuts)]) for cuts in every)
    return min((energy(features, edges, weights, labels), labels.tolist()) for labels in options)
