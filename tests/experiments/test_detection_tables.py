"""Tables of boxes: their options are keys of the config; counts by hand."""

import inspect
from pathlib import Path

import pytest

from rm3d_plugin.engine.config import load_config
from rm3d_plugin.experiments.run_commands import config_path, option_texts, parse_options
from rm3d_plugin.experiments.spec import Request
from rm3d_plugin.experiments.tables.detection import MECHANISMS
from rm3d_plugin.experiments.tables.pseudo_boxes import RULES, BoxCounts, fill_counts, trained_row
from rm3d_plugin.pseudo_labels import TeacherRules, detection_rules


@pytest.mark.parametrize('row', MECHANISMS.rows, ids=lambda row: row.name)
def test_each_mechanism_is_options_of_its_config(row):
    config = load_config(config_path(row.config), demo=True, options=parse_options(option_texts(row.options)))
    hook = next(hook for hook in config.custom_hooks if hook.type == 'RegionMergeHook')
    assert (hook.label_maker.teacher is None) == (row.options.get('teacher', 'default') is None)
    assert (config.model.iou_head is None) == ('BoxOverlap' not in [loss.type for loss in config.model.losses if loss])
    assert (config.model.tta_views is None) == ('tta_views' in row.options)
    assert config.model.losses[0].pseudo_geometry == row.options.get('pseudo_geometry', 0.0)


def test_prototypes_have_the_channels_of_the_network():
    row = next(row for row in MECHANISMS.rows if 'prototypes' in row.name)
    config = load_config(config_path(row.config), demo=True, options=parse_options(option_texts(row.options)))
    (loss,) = [loss for loss in config.model.losses if loss and loss.type == 'ClassPrototypes']
    assert (loss.channels, loss.num_classes) == (config.model.backbone.widths[0], 3)


def test_pseudo_boxes_are_counted_by_rule_and_class():
    counts = [BoxCounts(0, rule, name, n, n - 1, 9) for rule, n in (('a', 3), ('b', 5)) for name in ('Car', 'Cyclist')]
    table = fill_counts(counts)
    (section,) = table.sections
    assert section.columns[:3] == ('labels of round 1', 'Car: pseudo boxes', 'Car: right')
    assert [cell.text for cell in section.rows[1].cells] == ['5', '4', '9', '5', '4', '9']
    assert table.records[0] == {'seed': 0, 'rule': 'a', 'name': 'Car', 'pseudo': 3, 'right': 2, 'hidden': 9}


def test_real_frames_are_learnt_by_the_small_network():
    assert trained_row(Request(Path('out'))).train == ('--demo',)
    row = trained_row(Request(Path('out'), data_root=Path('kitti')))
    assert row.train == () and row.options['data_root'] == 'kitti'
    load_config(config_path(row.config), options=parse_options(option_texts(row.options | {'sigma': 4, 'periods': [40]}
                | {'restart_weights': [1]})))  # fmt: skip


def test_rules_are_those_of_predicted_boxes():
    fields = inspect.signature(TeacherRules).parameters
    assert all(set(rule.teacher or {}) <= set(fields) for rule in RULES.values())
    for rule in RULES.values():
        detection_rules(teacher=rule.teacher)
