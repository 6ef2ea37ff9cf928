"""What the features of labelled regions say of the class of all points."""

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.common.kernel_classifier import evenly_chosen, fit_kernel_classifier, normalised
from rm3d_plugin.pseudo_labels.propagation.labels import Labels
from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud
from rm3d_plugin.pseudo_labels.propagation.region_scales import RegionScale

LENGTH = 0.8  # of the kernel, in root mean square deviations of the features
LEAST = 1e-9  # share of a class that features rule out
OTHERS = 60  # examples of a class of other scans that teach where the scan has fewer; the time grows with the cube
SURE = 0.5  # share of the regions of a class in an answer that may teach: the surer ones
TAUGHT = 60  # of these that do, of each class


def class_shares(
    scene: PreparedCloud, labels: Labels, examples: int, answer: Float[np.ndarray, 'points classes'] | None = None
) -> Float[np.ndarray, 'points classes']:
    """How likely each class is by features, were all as frequent; the mean over regions of all sizes; rows of sum 1.

    Args:
        scene: The scan.
        labels: Of its points, and examples of other scans.
        examples: Labels of a class that teach, at most.
        answer: Of an earlier round: the regions that are surest of it teach, too. None: labels alone.
    """
    out = np.zeros((len(scene.cloud), labels.num_classes), dtype=np.float32)
    for scale in scene.scales:
        rows, classes = _own(scale, labels, examples)
        if answer is not None:
            sure, said = surest_regions(scale.mean(answer))
            rows, classes = np.concatenate([rows, scale.features[sure]]), np.concatenate([classes, said])
        taught = fit_kernel_classifier(rows, classes, scale.scaling, LENGTH)
        shares = normalised(np.maximum(taught.shares(scale.features, labels.num_classes), LEAST))
        out += shares.astype(np.float32)[scale.region] / len(scene.scales)
    return out


def surest_regions(
    answer: Float[np.ndarray, 'regions classes'],
) -> tuple[Int[np.ndarray, ' sure'], Int[np.ndarray, ' sure']]:
    """Of the regions that an answer gives to each class the surer half, evenly chosen, and their class.

    >>> surest_regions(np.array([[0.9, 0.1], [0.2, 0.8], [0.6, 0.4]]))
    (array([0, 1]), array([0, 1]))
    """
    said, share = answer.argmax(axis=1), answer.max(axis=1)
    order = np.argsort(-share, kind='stable')
    sure = [np.zeros(0, dtype=np.int64)]
    for own in np.unique(said):
        rows = order[said[order] == own]
        rows = rows[: max(int(SURE * len(rows)), 1)]
        sure.append(rows[np.linspace(0, len(rows) - 1, min(len(rows), TAUGHT)).astype(np.int64)])
    rows = np.concatenate(sure)
    return rows, said[rows]


def teaching_counts(labels: Labels) -> Int[np.ndarray, ' classes']:
    """How many teach each class: regions of the scan that are labelled, and examples of other scans."""
    there = np.bincount(labels.other_classes, minlength=labels.num_classes)
    return np.asarray(labels.region_counts + np.minimum(there, _most_others(labels.region_counts)), dtype=np.int64)


def _most_others(own: Int[np.ndarray, ' classes']) -> Int[np.ndarray, ' classes']:
    return np.maximum(own, OTHERS)


def _own(
    scale: RegionScale, labels: Labels, examples: int
) -> tuple[Float[np.ndarray, 'rows features'], Int[np.ndarray, ' rows']]:
    """Regions with a label, each once a place, and examples of other scans: as many as own ones, or :data:`OTHERS`."""
    regions = scale.region[labels.points]
    first = np.sort(np.unique(np.column_stack([regions, labels.places]), axis=0, return_index=True)[1])
    own = first[evenly_chosen(labels.classes[first], examples)]
    rows, classes = scale.features[regions[own]], labels.classes[own]
    most = _most_others(np.bincount(classes, minlength=labels.num_classes))
    for each in np.unique(labels.other_classes):
        lent = np.flatnonzero(labels.other_classes == each)
        lent = lent[evenly_chosen(labels.other_classes[lent], int(most[each]))]
        rows, classes = np.concatenate([rows, labels.others[lent]]), np.append(classes, labels.other_classes[lent])
    return rows, classes
