"""What labels of all scans tell: the estimate."""

import numpy as np

from rm3d_plugin.labeling.scan_knowledge import ScanKnowledge
from rm3d_plugin.pseudo_labels.propagation import WalkerRules
from rm3d_plugin.pseudo_labels.propagation.checked import CheckedLabels
from rm3d_plugin.pseudo_labels.propagation.estimate import calibrated, estimate_miou


def test_a_class_that_no_answer_names_counts_as_in_one_scan():
    rng = np.random.default_rng(0)
    shares = rng.dirichlet([0.2, 1.0, 1.0, 0.2], 4000)
    shares[:, 0] = np.minimum(shares[:, 0], 0.4 * shares[:, 1])  # class 0 is always called 1; class 3 is nowhere
    shares[:, 3] = 0.0
    shares /= shares.sum(axis=1, keepdims=True)
    left, classes = shares[:60], np.repeat([0, 1, 2], 20)
    found = np.bincount(shares.argmax(axis=1), minlength=4).astype(float)
    assert found[0] == found[3] == 0
    known = ScanKnowledge([], lambda scene: None, lambda scene: None, 4, WalkerRules(), 0.2, 0)
    known.__dict__['checked'] = CheckedLabels(left, classes, found)
    told = known.estimate([calibrated(shares[:2000], known.sharpness), calibrated(shares[2000:], known.sharpness)])
    alone = estimate_miou(shares[:, :3], left[:, :3], classes, WalkerRules().draws, np.random.default_rng(0))
    assert told.labels == 60 and told.sharpness == alone.sharpness
    np.testing.assert_allclose(told[:3], alone[:3], atol=1.0)
