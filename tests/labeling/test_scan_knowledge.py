"""What labels of all scans tell: the estimate."""

import numpy as np
from reference.corner_scan import FLOOR, WALL, corner

from rm3d_plugin.labeling.scan_knowledge import ScanKnowledge
from rm3d_plugin.pseudo_labels.propagation import WalkerRules
from rm3d_plugin.pseudo_labels.propagation.checked import CheckedLabels
from rm3d_plugin.pseudo_labels.propagation.estimate import calibrated, estimate_miou
from rm3d_plugin.pseudo_labels.propagation.scores import painted, shown
from rm3d_plugin.structures import PointCloud


def test_a_class_that_no_answer_names_counts_as_in_one_scan():
    rng = np.random.default_rng(0)
    shares = rng.dirichlet([0.2, 1.0, 1.0, 0.2], 4000)
    shares[:, 0] = np.minimum(shares[:, 0], 0.4 * shares[:, 1])  # class 0 is always called 1; class 3 is nowhere
    shares[:, 3] = 0.0
    shares /= shares.sum(axis=1, keepdims=True)
    left, classes = shares[:60], np.repeat([0, 1, 2], 20)
    found = np.bincount(shares.argmax(axis=1), minlength=4).astype(float)
    assert found[0] == found[3] == 0
    known = ScanKnowledge([], lambda scene: None, lambda scene: None, lambda scene: None, 4, WalkerRules(), 0.2, 0)
    known.__dict__['checked'] = CheckedLabels(left, classes, found)
    told = known.estimate([calibrated(shares[:2000], known.sharpness), calibrated(shares[2000:], known.sharpness)])
    alone = estimate_miou(shares[:, :3], left[:, :3], classes, WalkerRules().draws, np.random.default_rng(0))
    assert told.labels == 60 and told.sharpness == alone.sharpness
    np.testing.assert_allclose(told[:3], alone[:3], atol=1.0)


def knowledge(scans, judging, seed):
    """Of clouds with the class of each labelled point, which must not be prepared to tell who judges."""
    return ScanKnowledge(
        list(scans), lambda scene: scans[scene][0], None, lambda scene: scans[scene][1], 2, WalkerRules(), judging, seed
    )


def test_a_stroke_judges_as_a_whole_or_is_taught_as_a_whole():
    xyz, semantic = corner()
    floor, wall = np.flatnonzero(semantic == FLOOR), np.flatnonzero(semantic == WALL)
    middles = [*floor[[64, 78, 364, 784, 500]], wall[400]]
    strokes = [painted(xyz, semantic, np.array([middle]), 0.21) for middle in middles]
    scans = {'corner': (PointCloud(xyz.astype(np.float32)), shown(semantic, np.unique(np.concatenate(strokes))))}
    judging = set()
    for seed in range(20):
        judges = knowledge(scans, 0.4, seed).judges['corner']
        shares = [np.isin(stroke, judges).mean() for stroke in strokes]
        assert sorted(shares[:-1]) == [0.0, 0.0, 0.0, 1.0, 1.0]  # two of five
        assert shares[-1] == 0.0  # nothing else is shown of the wall
        judging |= set(np.flatnonzero(shares))
    assert judging == {0, 1, 2, 3, 4}


def test_a_stroke_a_class_in_each_scan_judges_in_a_share_of_the_scans():
    xyz, semantic = corner()
    middles = [np.flatnonzero(semantic == own)[[400]] for own in (FLOOR, WALL)]
    strokes = [painted(xyz, semantic, middle, 0.21) for middle in middles]
    one = PointCloud(xyz.astype(np.float32)), shown(semantic, np.concatenate(strokes))
    judges = knowledge({f'scan{number}': one for number in range(10)}, 0.2, 0).judges
    for own, stroke in zip((FLOOR, WALL), strokes, strict=True):
        shares = [np.isin(stroke, rows).mean() for rows in judges.values()]
        assert sorted(shares) == [0.0] * 8 + [1.0] * 2, own
