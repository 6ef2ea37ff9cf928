"""Seeds, records and checkpoints: each hook with a runner that is no more than its fields."""

import json
import random
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from mmengine.config import Config
from mmengine.optim import OneCycleLR

from rm3d_plugin.engine.checkpoint import load_weights, read_checkpoint
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.hooks import EpochSeedHook, RunRecordHook, SafeCheckpointHook
from rm3d_plugin.engine.hooks.region_merge_hook import RegionMergeHook
from rm3d_plugin.engine.hooks.run_record_hook import final_records, last_summary, read_record, score_records
from rm3d_plugin.engine.hooks.safe_checkpoint_hook import AtomicLocalBackend, latest_checkpoint
from rm3d_plugin.engine.loops import RoundTrainLoop
from rm3d_plugin.evaluation.records import RecordedMetric, share
from rm3d_plugin.storage import LabelStore
from rm3d_plugin.structures import Boxes3D, PseudoLabels


def draws(epoch, seed):
    EpochSeedHook().before_train_epoch(SimpleNamespace(epoch=epoch, seed=seed))
    return torch.rand(3).tolist(), np.random.rand(3).tolist(), random.random()  # noqa: NPY002


def test_an_epoch_draws_the_same_numbers_whatever_came_before():
    first = draws(3, seed=5)
    draws(2, seed=5)
    assert draws(3, seed=5) == first
    assert draws(4, seed=5) != first and draws(3, seed=6) != first
    assert draws(3, seed=None) == draws(3, seed=0)


class Recorded(RecordedMetric):
    """Has been evaluated."""

    def __init__(self):
        super().__init__(prefix='val')
        self.compute_metrics([0.25])

    def process(self, data_batch, data_samples):
        raise AssertionError('nothing is evaluated here')

    def score(self, results):
        return [share('AP', results[0], 'boxes', 'AP'), share('AP_car', float('nan'), 'boxes', 'AP', subject='car')]


def runner_at(work_dir, epoch=0, validate=None, val_interval=2, max_epochs=4, hooks=()):
    val_loop = None if validate is None else SimpleNamespace(run=validate)
    return SimpleNamespace(
        work_dir=str(work_dir),
        epoch=epoch,
        seed=7,
        cfg={'config_name': 'leaf', 'is_demo': True},
        hooks=hooks,
        val_loop=val_loop,
        train_loop=SimpleNamespace(val_interval=val_interval, max_epochs=max_epochs),
        val_evaluator=SimpleNamespace(metrics=[Recorded()]),
    )


ROWS = [
    {
        'key': key, 'value': value, 'table': 'boxes', 'measure': 'AP', 'subject': subject, 'variant': '', 'level': '',
        'unit': '%', 'headline': '', 'prefix': 'val',
    }
    for key, value, subject in (('AP', 25.0, ''), ('AP_car', None, 'car'))
]  # fmt: skip


def test_losses_are_averaged_over_an_epoch_and_scores_kept(tmp_path):
    hook, runner = RunRecordHook(), runner_at(tmp_path)
    hook.before_train(runner)
    for step, loss in enumerate((1.0, 2.0, 6.0)):
        hook.after_train_iter(runner, step, outputs={'loss': torch.tensor(loss, requires_grad=True), 'loss_a': loss})
    hook.after_train_epoch(runner)
    hook.after_train_iter(runner, 0, outputs={'loss': 0.5})
    runner.epoch = 1
    hook.after_train_epoch(runner)
    hook.after_val_epoch(runner, {'AP': 10.0})
    runner.epoch = 2
    hook.after_val_epoch(runner, {'AP': 20.0, 'empty': float('nan')})
    hook.after_train(runner)
    assert read_record(tmp_path) == {
        'losses': {'1': {'loss': 3.0, 'loss_a': 3.0}, '2': {'loss': 0.5}},
        'validation': {'1': {'AP': 10.0}, '2': {'AP': 20.0, 'empty': None}},
        'final': {'AP': 20.0, 'empty': None},
        'records': {'1': ROWS, '2': ROWS},
        'estimates': {},
        'config': 'leaf',
        'seed': 7,
        'synthetic': True,
    }


def record(tmp_path, losses, validation):
    content = {'losses': dict.fromkeys(losses, {}), 'validation': dict.fromkeys(validation, {}), 'final': {}}
    content['records'] = {epoch: ROWS for epoch in validation}
    (tmp_path / 'metrics.json').write_text(json.dumps(content))


def test_a_resumed_run_forgets_the_epochs_it_trains_again(tmp_path):
    record(tmp_path, ['1', '2', '3', '10'], ['2', '10'])
    hook = RunRecordHook()
    hook.before_train(runner_at(tmp_path, epoch=3))
    assert sorted(hook.record['losses']) == ['1', '2', '3'] and list(hook.record['validation']) == ['2']
    assert list(hook.record['records']) == ['2']
    hook.before_train(runner_at(tmp_path, epoch=0))
    assert hook.record['losses'] == hook.record['validation'] == {}


@pytest.mark.parametrize(
    ('epoch', 'there', 'made_up'),
    [(2, [], 1), (2, ['2'], 0), (3, ['2'], 0), (4, ['2'], 1), (4, ['2', '4'], 0), (0, [], 0)],
)
def test_a_validation_that_an_interrupted_run_did_not_reach_is_made_up(tmp_path, epoch, there, made_up):
    record(tmp_path, [], there)
    calls = []
    RunRecordHook().before_train(runner_at(tmp_path, epoch, validate=lambda: calls.append(epoch)))
    assert calls == [epoch] * made_up


def test_the_last_score_is_that_of_the_highest_epoch_not_of_the_highest_text(tmp_path):
    hook = RunRecordHook()
    hook.record = {'losses': {}, 'validation': {'9': {'AP': 1.0}, '10': {'AP': 2.0}}, 'final': {}}
    hook.after_train(runner_at(tmp_path))
    assert read_record(tmp_path)['final'] == {'AP': 2.0}


def test_records_come_back_in_the_order_of_the_epochs(tmp_path):
    record(tmp_path, [], ['10', '9'])
    found = read_record(tmp_path)
    assert list(score_records(found)) == [9, 10]
    assert [(r.name, r.value, r.subject) for r in final_records(found)] == [
        ('val/AP', 25, ''),
        ('val/AP_car', None, 'car'),
    ]
    assert final_records(read_record(tmp_path / 'none')) == ()


def test_the_latest_checkpoint_is_a_complete_one_of_the_highest_epoch(tmp_path):
    assert latest_checkpoint(tmp_path) is None and latest_checkpoint(tmp_path / 'absent') is None
    for name in ('epoch_9.pth', 'epoch_10.pth', 'epoch_best.pth', '.epoch_11.pth.1.x.tmp', 'iter_99.pth'):
        torch.save({'state_dict': {'weight': torch.ones(400)}}, tmp_path / name)
    (tmp_path / 'last_checkpoint').write_text('')
    assert latest_checkpoint(tmp_path) == tmp_path / 'epoch_10.pth'
    data = bytearray((tmp_path / 'epoch_10.pth').read_bytes())
    data[data.index(np.ones(4, np.float32).tobytes()) + 2] ^= 1  # a single bit of a weight
    (tmp_path / 'epoch_10.pth').write_bytes(data)
    with pytest.warns(UserWarning, match='epoch_10.pth: .*does not fit its checksum.* It is passed over'):
        assert latest_checkpoint(tmp_path) == tmp_path / 'epoch_9.pth'


@pytest.mark.parametrize('weight', [np.nan, np.inf, 1e30])
def test_absurd_weights_are_refused(tmp_path, weight):
    torch.save({'state_dict': {'count': torch.tensor(3), 'w': torch.tensor([1.0, weight])}}, tmp_path / 'epoch_1.pth')
    with pytest.raises(ConfigError, match='epoch_1.pth: weight w is NaN, infinite or absurdly large'):
        read_checkpoint(tmp_path / 'epoch_1.pth')


def test_a_failed_write_leaves_the_old_checkpoint_and_nothing_else(tmp_path):
    backend, path = AtomicLocalBackend(), tmp_path / 'runs' / 'epoch_1.pth'
    backend.put(b'old', path)
    with pytest.raises(TypeError):
        backend.put('no bytes', path)
    assert path.read_bytes() == b'old' and [p.name for p in path.parent.iterdir()] == ['epoch_1.pth']
    backend.put(b'new', str(path))
    assert path.read_bytes() == b'new'


def test_a_checkpoint_loads_without_running_code_and_brings_its_config(tmp_path):
    config = Config({'widths': [8, 16], 'nested': {'key': (1, 2)}, 'none': None})
    state = {'meta': {'epoch': 3}, 'state_dict': {'w': torch.ones(2)}, 'message_hub': {'log_scalars': {'x': object()}}}
    SafeCheckpointHook().before_save_checkpoint(SimpleNamespace(cfg=config), state)
    torch.save(state, tmp_path / 'epoch_3.pth')
    loaded = read_checkpoint(tmp_path / 'epoch_3.pth')
    assert json.loads(loaded['meta']['config_json']) == {'widths': [8, 16], 'nested': {'key': [1, 2]}, 'none': None}
    assert loaded['message_hub'] == {'log_scalars': {}, 'runtime_info': {}, 'resumed_keys': {}}


@pytest.mark.parametrize('several', [False, True], ids=['one optimizer', 'several'])
def test_a_schedule_that_keeps_a_function_is_saved_and_goes_on(tmp_path, several):
    def schedule():
        optimizer = torch.optim.SGD([torch.nn.Parameter(torch.ones(1))], lr=0.1)
        return optimizer, OneCycleLR(optimizer, eta_max=0.1, total_steps=9)

    (optimizer, unbroken), (other, resumed) = schedule(), schedule()
    for _ in range(4):
        optimizer.step()
        unbroken.step()
    states = [unbroken.state_dict()]
    state = {'meta': {}, 'state_dict': {}, 'param_schedulers': {'a': states} if several else states}
    SafeCheckpointHook().before_save_checkpoint(SimpleNamespace(cfg=Config({})), state)
    torch.save(state, tmp_path / 'epoch_1.pth')
    loaded = read_checkpoint(tmp_path / 'epoch_1.pth')['param_schedulers']
    resumed.load_state_dict(loaded['a'][0] if several else loaded[0])
    other.load_state_dict(optimizer.state_dict())
    for _ in range(4):
        for part in (optimizer, unbroken, other, resumed):
            part.step()
        assert other.param_groups[0]['lr'] == optimizer.param_groups[0]['lr']


def test_a_new_run_sweeps_up_parts_of_checkpoints(tmp_path):
    for name in ('.epoch_2.pth.1.abc.tmp', 'epoch_1.pth', 'notes.tmp'):
        (tmp_path / name).write_bytes(b'')
    SafeCheckpointHook().before_run(SimpleNamespace(work_dir=str(tmp_path)))
    assert sorted(path.name for path in tmp_path.iterdir()) == ['epoch_1.pth', 'notes.tmp']


def test_weights_of_another_model_are_refused(tmp_path):
    linear = torch.nn.Linear(2, 3)
    load_weights(linear, {'state_dict': {'weight': torch.zeros(3, 2), 'bias': torch.ones(3)}}, 'a.pth')
    assert linear.bias.tolist() == [1, 1, 1]
    for weights in ({'weight': torch.zeros(3, 2)}, {'weight': torch.zeros(2, 2), 'bias': torch.ones(3)}):
        with pytest.raises(ConfigError, match=r'a\.pth: its weights do not fit the model.*(bias|weight)'):
            load_weights(linear, {'state_dict': weights}, 'a.pth')


def test_the_loop_trains_rounds_of_sigma_epochs():
    loader = SimpleNamespace(dataset=SimpleNamespace(metainfo={}), sampler=None)
    runner = SimpleNamespace(visualizer=SimpleNamespace())
    settings = torch.utils.data.DataLoader([1, 2])
    loop = RoundTrainLoop(runner, settings, rounds=4, sigma=3, val_rounds=2)
    assert (loop.max_epochs, loop.val_interval, loop.max_iters) == (12, 6, 24)
    for name in ('rounds', 'sigma', 'val_rounds'):
        with pytest.raises(ValueError, match=f'RoundTrainLoop.{name}: expected at least 1, got 0'):
            RoundTrainLoop(runner, loader, **{'rounds': 1, 'sigma': 1, name: 0})


def test_estimates_of_the_labels_are_kept_by_round(tmp_path):
    store, nobody = LabelStore(tmp_path / 'labels'), np.full(3, -1)
    labels = PseudoLabels(nobody, nobody, nobody >= 0, np.zeros(3, np.float32), Boxes3D.empty(), np.zeros(0, bool))
    estimate = {'miou': 68.2, 'low': 60.9, 'high': 75.0, 'clicks': 240}
    for number, summary in enumerate(({}, {'estimate': None}, {'estimate': estimate})):
        store.begin_round(number)
        store.write(number, 'a', labels)
        store.finish_round(number, summary)
    label_maker = SimpleNamespace(store=store)
    hook, runner = RunRecordHook(), runner_at(tmp_path, hooks=[RegionMergeHook(1, label_maker, [])])
    hook.before_train(runner)
    hook.after_train(runner)
    kept = read_record(tmp_path)
    assert kept['estimates'] == {'1': None, '2': estimate} and last_summary(kept) == {'estimate': estimate}
    assert last_summary({'estimates': {}}) == {}
