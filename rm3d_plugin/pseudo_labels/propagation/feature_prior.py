"""What the features of labelled nodes say of the class of others."""

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.common.kernel_classifier import Scaling, evenly_chosen, fit_kernel_classifier, normalised

LENGTH = 0.8  # of the kernel, in root mean square deviations of the features: that of the region classifier
LEAST = 1e-9  # share of a class that features rule out


def feature_prior(
    features: Float[np.ndarray, 'nodes features'],
    scaling: Scaling,
    labelled: Int[np.ndarray, ' labelled'],
    classes: Int[np.ndarray, ' labelled'],
    count: int,
    examples: int,
) -> Float[np.ndarray, 'nodes classes']:
    """How likely each class is for nodes by their features, were all as frequent; rows of sum 1.

    Args:
        features: Of all nodes.
        scaling: Of the same.
        labelled: Nodes with a label.
        classes: Of each, from 0 to ``count`` - 1.
        count: Number of classes.
        examples: Labels of a class that teach, at most.
    """
    chosen = evenly_chosen(classes, examples)
    taught = fit_kernel_classifier(features[labelled[chosen]], classes[chosen], scaling, LENGTH)
    return normalised(np.maximum(taught.shares(features, count), LEAST))
