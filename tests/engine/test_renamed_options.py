"""Old names of options lead to fields and keys that there are."""

from dataclasses import fields

import pytest

from rm3d_plugin.engine.config import ConfigError, load_config
from rm3d_plugin.engine.config_files import shipped_leaves
from rm3d_plugin.engine.renamed_options import HINTS, RENAMED, RENAMED_CONFIGS
from rm3d_plugin.pseudo_labels.common.self_training import SelfTrainingRules
from rm3d_plugin.pseudo_labels.detection.rules import ObjectRules
from rm3d_plugin.pseudo_labels.ground.rules import GroundRules
from rm3d_plugin.pseudo_labels.region_prior.rules import RegionPriorRules
from rm3d_plugin.pseudo_labels.segmentation.propagation import PropagationRules
from rm3d_plugin.regions import MergeRules

RULES = {
    'merge': MergeRules,
    'propagation': PropagationRules,
    'region_prior': RegionPriorRules,
    'ground': GroundRules,
    'self_training': SelfTrainingRules,
    'objects': ObjectRules,
}


@pytest.mark.parametrize('old', sorted(RENAMED))
def test_the_new_name_is_a_field_of_the_rules(old):
    group, _, name = RENAMED[old].partition('.')
    assert group not in ('strategy', 'rules') and RENAMED[old] not in RENAMED
    if name and group in RULES:
        assert name in [item.name for item in fields(RULES[group])]
    if not RENAMED[old]:
        assert HINTS[old]


def test_hints_are_of_renamed_options_and_every_class_of_rules_is_small():
    assert set(HINTS) <= set(RENAMED)
    assert all(len(fields(rules)) <= 16 for rules in RULES.values())


@pytest.mark.parametrize('old', sorted(RENAMED_CONFIGS))
def test_the_old_name_of_a_config_is_told_with_the_new_one(old):
    assert old not in shipped_leaves() and RENAMED_CONFIGS[old] in shipped_leaves()
    for name in (old, f'rm3d_plugin::{old}.py'):
        with pytest.raises(ConfigError, match=f'no such config; it is now {RENAMED_CONFIGS[old]}'):
            load_config(name)
