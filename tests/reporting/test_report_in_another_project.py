"""What the report needs of a project is told before training, not after it."""

import logging
from types import SimpleNamespace

import pytest

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.hooks import RegionMergeHook
from rm3d_plugin.reporting.report_hook import ReportHook


def runner_with(hooks, dataset=None):
    loop = None if dataset is None else SimpleNamespace()
    loader = SimpleNamespace(dataset=dataset)
    return SimpleNamespace(hooks=hooks, logger=logging.getLogger('report'), val_loop=loop, val_dataloader=loader)


def merging(task, dataset):
    hook = RegionMergeHook(1, SimpleNamespace(task=task), dataloader=SimpleNamespace(dataset=dataset))
    return [hook]


def test_without_labels_there_is_no_page_and_that_is_told(caplog):
    hook, runner = ReportHook(), runner_with([])
    hook.before_train(runner)
    hook.after_train(runner)
    assert 'ReportHook: there is no RegionMergeHook' in caplog.text


def test_data_sets_that_cannot_be_drawn_are_told_before_training():
    with pytest.raises(ConfigError, match=r'ReportHook: list has no scene_ids, so .* or set train_scenes=0'):
        ReportHook().before_train(runner_with(merging('segmentation', [])))
    with pytest.raises(ConfigError, match=r'list has no scene_ids, load_cloud, load_truth, .* or set val_scenes=0'):
        ReportHook().before_train(runner_with(merging('detection', []), dataset=[]))
    ReportHook(train_scenes=0, val_scenes=0).before_train(runner_with(merging('segmentation', []), dataset=[]))
