"""What the features of labelled nodes say of the class of others."""

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.common.kernel_classifier import Scaling, evenly_chosen, fit_kernel_classifier, normalised
from rm3d_plugin.pseudo_labels.propagation.labels import Labels

LENGTH = 0.8  # of the kernel, in root mean square deviations of the features: that of the region classifier
OTHERS = 20  # examples of a class of other scans that teach where the scan has fewer
LEAST = 1e-9  # share of a class that features rule out


def feature_prior(
    features: Float[np.ndarray, 'nodes features'], scaling: Scaling, labels: Labels, examples: int
) -> Float[np.ndarray, 'nodes classes']:
    """How likely each class is for nodes by their features, were all as frequent; rows of sum 1.

    Args:
        features: Of all nodes.
        scaling: Of the same.
        labels: What teaches: labelled nodes, and examples of other scans, of which no more than there are labels of
            the scan's own of a class, or :data:`OTHERS`.
        examples: Labels of a class that teach, at most.
    """
    own = evenly_chosen(labels.classes, examples)
    rows, classes = features[labels.nodes[own]], labels.classes[own]
    if len(labels.others):
        lent = _lent(labels, np.bincount(classes, minlength=labels.num_classes))
        rows = np.concatenate([rows, labels.others[lent]])
        classes = np.concatenate([classes, labels.other_classes[lent]])
    taught = fit_kernel_classifier(rows, classes, scaling, LENGTH)
    return normalised(np.maximum(taught.shares(features, labels.num_classes), LEAST))


def _lent(labels: Labels, counts: Int[np.ndarray, ' classes']) -> Int[np.ndarray, ' lent']:
    """Examples of other scans that teach, evenly chosen."""
    lent = [np.zeros(0, dtype=np.int64)]
    for own in np.unique(labels.other_classes):
        rows = np.flatnonzero(labels.other_classes == own)
        lent.append(rows[evenly_chosen(labels.other_classes[rows], max(OTHERS, int(counts[own])))])
    return np.concatenate(lent)
