"""Rules of a detection run: as printed, or with ours."""

import pytest

from rm3d_plugin.pseudo_labels import DetectionRules, ObjectRules, SelfTrainingRules, detection_rules
from rm3d_plugin.pseudo_labels.detection.rules import AS_PRINTED
from rm3d_plugin.regions import MergeRules

OURS = {'objects': {'gamma': 0.4, 'class_gamma': (0.4, 1.1)}, 'self_training': {'cbst_fraction': 0.2}}


def test_the_papers_strategy_reads_the_rules_of_merging_alone():
    paper = detection_rules('paper', {'rounds': 4}, **OURS)
    assert paper == DetectionRules(MergeRules(rounds=4), AS_PRINTED)
    assert (paper.merge.gamma, AS_PRINTED.box, AS_PRINTED.top_fraction) == (0.75, 'axis_aligned', None)
    assert AS_PRINTED.part_share > 1  # regions stay whole


def test_the_default_adds_ours_and_the_confidence_of_objects_counts():
    default = detection_rules('default', {'rounds': 4}, **OURS)
    assert default.merge == MergeRules(rounds=4, gamma=0.4)
    assert default.objects == ObjectRules(gamma=0.4, class_gamma=(0.4, 1.1))
    assert default.self_training == SelfTrainingRules(cbst_fraction=0.2)
    assert detection_rules() == DetectionRules(MergeRules())
    with pytest.raises(ValueError, match=r'MergeRules\.gamma: expected to be left out where ObjectRules\.gamma=0\.4'):
        detection_rules('default', {'gamma': 0.8}, **OURS)
