"""When labels are made: counted with a mock runner, and in a real run."""

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from mmengine.runner import IterBasedTrainLoop
from runs import tiny_runs

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.hooks.region_merge_hook import RegionMergeHook
from rm3d_plugin.engine.round_times import RoundTimes
from rm3d_plugin.engine.scene_prediction import scene_prediction
from rm3d_plugin.labeling.label_maker import LabelMaker
from rm3d_plugin.storage import LabelStore, read_json
from rm3d_plugin.structures import LabelStatistics, SceneError, SceneSample


class CountingLabelMaker:
    """Notes what it is asked to do, in order."""

    def __init__(self, finished: tuple[int, ...] = ()) -> None:
        self.events: list[tuple[Any, ...]] = []
        self.finished = set(finished)
        self.in_use: int | None = None
        self.told: list[int | None] = []  # the round in use whenever a model was told of the labels
        self.predictions: list[Any] = []
        self.source = SimpleNamespace(extends=lambda number: number in self.extending, grown=False)
        self.store = SimpleNamespace(forget_rounds=lambda first: self.events.append(('forget', first)))
        self.extending: tuple[int, ...] = ()
        self.reads_features = True

    def open(self, keep, log):
        self.events.append(('open', keep))

    def make_first_labels(self):
        self.events.append(('first',))

    def statistics(self):
        self.told.append(self.in_use)
        return LabelStatistics(np.array([3, 1]))

    def extend_budget(self, number, predictions):
        self.events.append(('extend', number, [scene for scene, _ in predictions]))

    def check(self, number, log):
        self.events.append(('check', number))

    def evaluate(self, number):
        return {'coverage': number}

    def is_finished(self, number):
        return number in self.finished

    def begin(self, number):
        self.events.append(('begin', number))

    def refresh(self, number, scene_id, prediction):
        self.events.append(('refresh', number, scene_id))
        self.predictions.append(prediction)

    def refresh_all(self, number, predictions):
        for scene_id, prediction in predictions:
            self.refresh(number, scene_id, prediction)

    def finish(self, number, summary, log):
        self.events.append(('finish', number, summary['coverage']))
        self.finished.add(number)

    def use(self, number):
        self.in_use = number
        self.events.append(('use', number))


class Model(torch.nn.Module):
    """Sees points 0 and 2 of three."""

    predict_points, predict_features = False, False
    statistics = None

    def set_label_statistics(self, statistics):
        self.statistics = statistics.class_counts.tolist()

    def test_step(self, batch):
        assert self.predict_points and self.predict_features
        assert not self.training and not torch.is_grad_enabled()
        sample = SceneSample(metainfo={'scene_id': batch, 'num_points': 3})
        sample.point_index = torch.tensor([2, 0])
        sample.pred_point_probs = torch.tensor([[0.25, 0.75], [1.0, 0.0]])
        sample.pred_point_centers = torch.tensor([[1.0, 2, 3], [4, 5, 6]])
        return [sample]


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def epochs(hook, label_maker, first, last) -> list[list[tuple[Any, ...]]]:
    """Run epochs first..last - 1 of a runner without data; what the label_maker was asked in each."""
    runner = SimpleNamespace(epoch=first, seed=5, model=Model(), logger=SimpleNamespace(info=print), work_dir='.')
    runner.train_loop = None
    runner.build_dataloader = lambda loader, seed: loader if seed == 5 else None
    hook.before_train(runner)
    assert runner.model.statistics == [3, 1]
    out = []
    for runner.epoch in range(first, last):
        label_maker.events.clear()
        runner.model.train()
        hook.before_train_epoch(runner)
        assert not runner.model.predict_points
        hook.after_train_epoch(runner)
        out.append(list(label_maker.events))
    return out


def refreshed(number):
    labels = [('refresh', number, 'a'), ('refresh', number, 'b')]
    return [('begin', number), *labels, ('check', number), ('finish', number, number), ('use', number)]


def test_every_interval_epochs_a_new_round_until_there_are_enough():
    label_maker = CountingLabelMaker(finished=(0,))
    hook = RegionMergeHook(interval=2, label_maker=label_maker, dataloader=['a', 'b'], rounds=3)
    asked = epochs(hook, label_maker, 0, 8)
    kept = [[('use', 2)]] * 3
    assert asked == [[('use', 0)]] * 2 + [refreshed(1), [('use', 1)], refreshed(2), *kept]
    assert label_maker.told == [None, 0, 1, 2], 'a model is told at the start, and once a round is in use'
    assert hook.seconds > 0
    assert [row.round for row in hook.times.rounds()] == [0, 1, 2]
    assert [entry['round'] for entry in read_json('timing.json')['epochs'].values()] == [0, 0, 1, 1, 2, 2, 2, 2]


def test_labels_by_a_teacher_are_what_the_teacher_says():
    label_maker = CountingLabelMaker(finished=(0,))
    hook = RegionMergeHook(1, label_maker, dataloader=['a'], rounds=2, labels_from='teacher')
    runner = SimpleNamespace(model=Model(), hooks=[hook], train_loop=None)
    with pytest.raises(ConfigError, match=r"labels_from: 'teacher', but the network has none; add method_hook"):
        hook.before_train(runner)
    runner.model.teacher, runner.model.test_step = Model(), None  # the network is not asked
    label_maker.begin(1)
    hook._refresh(SimpleNamespace(model=runner.model, logger=SimpleNamespace(info=print)), 1)
    (said,) = label_maker.predictions
    assert said.probabilities[2].tolist() == [0.25, 0.75] and not runner.model.teacher.predict_points
    assert not runner.model.predict_points
    with pytest.raises(ValueError, match=r"labels_from: expected 'network' or 'teacher', got 'ema'"):
        RegionMergeHook(1, label_maker, dataloader=[], labels_from='ema')


def test_before_training_the_first_labels_are_made_and_the_model_is_told_sizes():
    label_maker = CountingLabelMaker()
    epochs(RegionMergeHook(interval=2, label_maker=label_maker, dataloader=[]), label_maker, 0, 0)
    assert label_maker.events == [('open', False), ('first',), ('check', 0), ('finish', 0, 0)]


def test_a_source_that_asks_for_it_shows_more_before_a_round_is_made():
    label_maker = CountingLabelMaker(finished=(0,))
    label_maker.extending = (1,)
    hook = RegionMergeHook(interval=1, label_maker=label_maker, dataloader=['a', 'b'], rounds=3)
    begin, *rest = refreshed(1)
    assert epochs(hook, label_maker, 1, 3) == [[begin, ('extend', 1, ['a', 'b']), *rest], refreshed(2)]


def test_the_first_labels_may_last_longer():
    label_maker = CountingLabelMaker(finished=(0,))
    hook = RegionMergeHook(interval=2, label_maker=label_maker, dataloader=['a', 'b'], rounds=4, warm_up_rounds=2)
    asked = epochs(hook, label_maker, 0, 8)
    assert asked == [[('use', 0)]] * 4 + [refreshed(1), [('use', 1)], refreshed(2), [('use', 2)]]


def test_one_round_means_that_the_first_labels_stay():
    label_maker = CountingLabelMaker(finished=(0,))
    hook = RegionMergeHook(interval=1, label_maker=label_maker, dataloader=['a'], rounds=1)
    assert epochs(hook, label_maker, 0, 4) == [[('use', 0)]] * 4


@pytest.mark.parametrize('finished', [(0, 1), (0,)])
def test_a_resumed_run_refreshes_only_what_is_not_complete(finished):
    label_maker = CountingLabelMaker(finished)
    hook = RegionMergeHook(interval=2, label_maker=label_maker, dataloader=['a', 'b'], rounds=2)
    asked = epochs(hook, label_maker, 2, 4)
    assert asked == [[('use', 1)] if 1 in finished else refreshed(1), [('use', 1)]]


def test_a_run_resumed_inside_a_round_goes_on_with_its_labels():
    label_maker = CountingLabelMaker(finished=(0, 1))
    hook = RegionMergeHook(interval=2, label_maker=label_maker, dataloader=['a', 'b'], rounds=3)
    assert epochs(hook, label_maker, 3, 5) == [[('use', 1)], refreshed(2)]


def test_predictions_are_scattered_to_all_points_of_the_scene():
    label_maker = CountingLabelMaker(finished=(0,))
    epochs(RegionMergeHook(interval=1, label_maker=label_maker, dataloader=['a'], rounds=2), label_maker, 1, 2)
    (prediction,) = label_maker.predictions
    nan = np.nan
    np.testing.assert_array_equal(prediction.probabilities, [[1, 0], [nan, nan], [0.25, 0.75]])
    np.testing.assert_array_equal(prediction.centers, [[4, 5, 6], [nan, nan, nan], [1, 2, 3]])


def test_a_sample_may_leave_out_centres_and_indices_but_not_probabilities():
    sample = SceneSample(metainfo={'scene_id': 's1'})
    with pytest.raises(SceneError, match='scene s1 has no pred_point_probs'):
        scene_prediction(sample)
    sample.pred_point_probs = torch.tensor([[0.5, 0.5]])
    scene, prediction = scene_prediction(sample)
    assert scene == 's1'
    assert prediction.centers is None and prediction.probabilities.tolist() == [[0.5, 0.5]]


@pytest.mark.parametrize(
    ('fields', 'message'),
    [
        (dict(pred_point_probs=torch.tensor([[2.0, -1.0]])), r's1: pred_point_probs: .*got shape \(1, 2\) and -1 to 2'),
        (dict(pred_point_probs=torch.tensor([[3.0, 4.0]])), r'logits\? give logits.softmax\(dim=1\)'),
        (dict(pred_point_probs=torch.tensor([0, 1])), r'got shape \(2,\)'),
        (dict(pred_point_probs=torch.tensor([[torch.inf, 0.0]])), 'sum to 1'),
        (dict(point_index=torch.tensor([0, 1])), 'pred_point_probs: expected 2 rows, one for each input point, got 1'),
        (dict(pred_point_centers=torch.zeros(2, 3)), 'pred_point_centers: expected 1 rows'),
        (dict(point_index=torch.tensor([1])), r'point_index: expected 0..0 \(num_points=1\), got 1..1'),
    ],
)
def test_what_is_no_probability_of_each_point_is_refused(fields, message):
    sample = SceneSample(metainfo={'scene_id': 's1'}, pred_point_probs=torch.tensor([[0.5, 0.5]]))
    sample.set_data(fields)
    with pytest.raises(SceneError, match=message):
        scene_prediction(sample)


def test_half_precision_and_unseen_points_are_probabilities():
    probs = torch.tensor([[0.3, 0.3, 0.4], [torch.nan] * 3]).bfloat16()
    sample = SceneSample(metainfo={'scene_id': 's1'}, pred_point_probs=probs)
    assert scene_prediction(sample)[1].probabilities[0] == pytest.approx([0.3, 0.3, 0.4], abs=2e-3)


@pytest.mark.parametrize('shape', [(4, 3), (2, 3), (3, 2)])
def test_predictions_of_another_size_are_refused_before_labels_are_made(shape):
    source = SimpleNamespace(scene_ids=('a', 'b'), classes=('x', 'y'))
    label_maker = SimpleNamespace(store=SimpleNamespace(scenes=lambda number: {'a': SimpleNamespace(points=3)}))
    label_maker.source, label_maker.task = source, 'detection'
    prediction = SimpleNamespace(probabilities=np.zeros(shape))
    with pytest.raises(SceneError, match=r'scene a: pred_point_probs: expected 3 rows .* and 3 columns .*background'):
        list(LabelMaker.checked(label_maker, [('a', prediction)]))
    with pytest.raises(SceneError, match='scene b was predicted, but is none of the 1'):
        list(LabelMaker.checked(label_maker, [('b', prediction)]))


def test_training_by_iterations_and_models_that_cannot_be_told_are_refused():
    hook = RegionMergeHook(interval=1, label_maker=CountingLabelMaker(), dataloader=[])
    by_iterations = IterBasedTrainLoop.__new__(IterBasedTrainLoop)
    with pytest.raises(ConfigError, match=r'training runs by iterations; set train_cfg=dict\(by_epoch=True'):
        hook.before_train(SimpleNamespace(train_loop=by_iterations, model=Model()))
    with pytest.raises(ConfigError, match='Linear has no set_label_statistics'):
        hook.before_train(SimpleNamespace(train_loop=None, model=torch.nn.Linear(1, 1)))


@pytest.mark.parametrize('field', ['interval', 'rounds', 'warm_up_rounds'])
def test_numbers_start_at_one(field):
    with pytest.raises(ValueError, match=f'RegionMergeHook.{field}: expected at least 1, got 0'):
        RegionMergeHook(**{'interval': 1, 'label_maker': CountingLabelMaker(), 'dataloader': [], field: 0})


def test_a_run_tells_what_its_labels_cost(finished):
    first, second = RoundTimes(finished.folder, epoch=2).rounds()
    assert (first.round, second.round) == (0, 1) and first.predicting == 0
    assert second.labels > second.predicting > 0 and second.training > 0 and 0 < second.share < 20
    assert re.search(r'labels of round 1 took [\d.]+ s, \d+ % of the training before', finished.log)
    page = (finished.folder / 'report.html').read_text()
    assert 'Labels / training' in page and f'{100 * second.share:.1f} %' in page
    assert 'timing' not in (finished.folder / 'metrics.json').read_text()  # equal runs leave equal records


def test_a_real_run_of_two_rounds_refreshes_each_scene_once_a_round(finished):
    scenes = ['000000', '000001', '000002']
    expected = [(0, scene, 'geometry') for scene in scenes] + [(1, scene, 'network') for scene in scenes]
    assert tiny_runs.refreshes(finished.log) == expected
    store = LabelStore(finished.folder / 'labels')
    assert list(store.scenes(1)) == scenes and store.current_round() == 1


def test_annotated_labels_stay_as_they_are_from_round_to_round(finished):
    store = LabelStore(finished.folder / 'labels')
    annotated = 0
    for scene in store.scenes(0):
        first, second = store.read(scene, 0), store.read(scene, 1)
        np.testing.assert_array_equal(first.point_is_annotated, second.point_is_annotated)
        np.testing.assert_array_equal(
            first.semantic[first.point_is_annotated], second.semantic[second.point_is_annotated]
        )
        for labels in (first, second):
            assert labels.box_is_annotated[: labels.box_is_annotated.sum()].all()
        np.testing.assert_array_equal(
            first.boxes.tensor[first.box_is_annotated], second.boxes.tensor[second.box_is_annotated]
        )
        annotated += int(first.box_is_annotated.sum())
    assert annotated == 1  # two boxes per ten scenes, at least one


@pytest.mark.parametrize(
    ('epoch', 'warm_up', 'first'), [(2, 1, 1), (3, 1, 2), (4, 1, 2), (2, 2, 1), (3, 2, 1), (4, 2, 1), (5, 2, 2)]
)
def test_rounds_to_come_are_made_again_where_the_budget_has_grown(epoch, warm_up, first):
    label_maker = CountingLabelMaker(finished=(0, 1, 2))
    label_maker.source.grown = True
    hook = RegionMergeHook(interval=2, label_maker=label_maker, dataloader=[], rounds=3, warm_up_rounds=warm_up)
    for number in (epoch, epoch + 1):
        Path(f'epoch_{number}.pth').touch()
    epochs(hook, label_maker, epoch, epoch)
    assert label_maker.events == [('open', True), ('forget', first)]
    assert Path(f'epoch_{epoch}.pth').is_file() and not Path(f'epoch_{epoch + 1}.pth').exists()
