"""Damaged files of every store of a run: what was written, or a message that names the file; no other error.

``make fuzz`` tries many more (RM3D_FUZZ = cases of each kind).
"""

import json
import os
import time
import tracemalloc
import warnings
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
import torch
from jaxtyping import config
from mmengine.config import Config
from runs.random_segmentor import make_checkpoint
from storage.damage import damaged, damaged_arrays, damaged_value

from rm3d_plugin.annotation import ClickLog
from rm3d_plugin.engine.checkpoint import read_checkpoint
from rm3d_plugin.engine.hooks.run_record_hook import final_records, last_summary, read_record, score_records
from rm3d_plugin.engine.round_times import RoundTimes
from rm3d_plugin.engine.work_dir import check_same_settings, choose_checkpoint, plain_settings, take_over
from rm3d_plugin.inference.trained import load_network
from rm3d_plugin.label_budgets import PointBudget, SceneSize, load_point_budget, point_amount, save_point_budget
from rm3d_plugin.label_budgets.audit import AnnotatedPoints
from rm3d_plugin.labeling.data_record import check_data
from rm3d_plugin.oversegmentation.precomputed import Precomputed
from rm3d_plugin.reporting.scores import final_text, loss_charts, score_chart
from rm3d_plugin.storage import Click, LabelStore, SceneCache, read_clicks, write_clicks
from rm3d_plugin.storage.files import read_npz, write_npz
from rm3d_plugin.structures import Boxes3D, PointCloud, PseudoLabels
from rm3d_plugin.user_error import UserError

CASES = int(os.environ.get('RM3D_FUZZ', '6'))
N = 40
SLACK = 1 << 20  # bytes that a reader may take whatever the size of the file


class Store(NamedTuple):
    """A file, and what reads it."""

    path: Path
    read: Callable[[], object]


def label_store(folder):
    store = LabelStore(folder / 'labels')
    boxes = Boxes3D(np.array([[0.0, 0, 0, 4, 2, 1, 0]]), np.array([1]))
    labels = PseudoLabels(
        np.arange(N) % 3, np.full(N, -1), np.arange(N) < 5, np.ones(N, np.float32), boxes, np.array([True])
    )
    store.begin_round(0)
    store.write(0, 'a', labels, {'x': np.arange(5.0)})
    store.finish_round(0, {'coverage': 0.5, 'estimate': None})
    store.set_current(0)
    store.keep('region_prior', 'a', {'rows': np.ones((3, 2))})
    return store


def scene_labels(folder):
    store = label_store(folder)
    return Store(store.scene_path(0, 'a'), lambda: store.read('a', 0))


def ledger(folder):
    store = label_store(folder)
    return Store(store.ledger_path(0, 'a'), lambda: store.read_ledger('a', 0))


def kept(folder):
    store = label_store(folder)
    return Store(store.root / 'kept' / 'region_prior' / 'a.npz', lambda: store.read_kept('region_prior', 'a'))


def complete(folder):
    store = label_store(folder)
    return Store(store.root / 'round_000' / 'complete.json', lambda: (store.scenes(0), store.summary(0)))


def current(folder):
    store = label_store(folder)
    return Store(store.root / 'current.json', lambda: store.read('a'))


def cache(folder):
    kept = SceneCache(folder)
    made = {'values': np.arange(30.0)}

    def read():
        np.testing.assert_array_equal(kept.get_or_make('key', lambda: made)['values'], made['values'])

    read()
    return Store(kept.path('key'), read)


def clicks(ending):
    def build(folder):
        path = folder / f'clicks{ending}'
        write_clicks(path, [Click('a', i % 2, index=i, xyz=(i, 0.5, 2.25)) for i in range(9)], ('x', 'y'))
        return Store(path, lambda: read_clicks(path, ('x', 'y')))

    return build


def click_log(folder):
    path = folder / 'session.jsonl'
    log = ClickLog(path, ('x', 'y'))
    for i in range(5):
        log.add(Click('a', i % 2, index=i))
    log.undo()
    return Store(path, lambda: ClickLog(path, ('x', 'y')).clicks)


def checkpoint(folder):
    path = make_checkpoint(folder / 'epoch_1.pth')
    return Store(path, lambda: (read_checkpoint(path), load_network(path)))


def newest_checkpoint(folder):
    take_over(folder, {}, clear=False)
    path = make_checkpoint(folder / 'epoch_1.pth')
    return Store(path, lambda: choose_checkpoint(folder, resume=True, overwrite=False))


def embedded_config(folder):
    """The config inside a checkpoint, whose other bytes are whole."""
    path, inner = make_checkpoint(folder / 'net.pth'), folder / 'config.json'
    state = torch.load(path, weights_only=True)
    inner.write_text(state['meta']['config_json'])

    def read():
        state['meta']['config_json'] = inner.read_text(errors='replace')
        torch.save(state, path)
        try:
            return load_network(path)
        except UserError as error:
            raise UserError(f'{inner}: {error}') from error

    return Store(inner, read)


def record(folder):
    rows = [
        dict(key='AP', value=25.0, table='boxes', measure='AP', subject='', variant='', level='', unit='%', headline='',
             prefix='val')
    ]  # fmt: skip
    content = dict(
        losses={'1': {'loss': 1.5}}, validation={'1': {'val/AP': 25.0}}, final={'val/AP': 25.0}, records={'1': rows},
        estimates={'0': dict(miou=60.0, low=50.0, high=70.0, clicks=40)}, config='leaf', seed=0, synthetic=False,
    )  # fmt: skip
    (folder / 'metrics.json').write_text(json.dumps(content))

    def read():
        found = read_record(folder)
        loss_charts(found['losses']), score_chart(score_records(found))
        return final_text(final_records(found), last_summary(found))

    return Store(folder / 'metrics.json', read)


def times(folder):
    content = dict(labels={'0': dict(wall=1.0, cpu=1.0)}, predicting={}, evaluating={}, epochs={})
    content['epochs'] = {'1': dict(round=0, wall=2.0, cpu=2.0)}
    (folder / 'timing.json').write_text(json.dumps(content))
    return Store(folder / 'timing.json', lambda: RoundTimes(folder, epoch=1).rounds())


def settings(folder):
    plain = plain_settings(Config(dict(work_dir=str(folder), sigma=2, model=dict(type='Net', widths=[8, 16]))))
    take_over(folder, plain, clear=False)
    return Store(folder / 'settings.json', lambda: check_same_settings(folder, plain))


def manifest(folder):
    """A damaged manifest leads to no file but those of the folder."""
    work, mine = folder / 'run', folder / 'mine.txt'
    work.mkdir()
    mine.write_text('mine')
    (work / 'written_files.txt').write_text('a.txt\nb/c.txt\n')

    def read():
        take_over(work, {}, clear=True)
        assert mine.read_text() == 'mine'

    return Store(work / 'written_files.txt', read)


def data_record(folder):
    shown = SimpleNamespace(complete=False, semantic=np.zeros(3, int), boxes=Boxes3D.empty())
    source = SimpleNamespace(
        scene_ids=['a'], load_cloud=lambda index: PointCloud(np.ones((3, 3))), annotated_labels=lambda index: shown
    )
    check_data(folder, source, keep=False)
    return Store(folder / 'data.json', lambda: check_data(folder, source, keep=True))


def point_budget(folder):
    points = {'a': AnnotatedPoints(np.array([1, 5]), np.array([0, 1]), np.array([-1, 2]))}
    counts = {0: 20, 1: 20}
    amount = point_amount('0p2pct')
    save_point_budget(
        folder / 'budget.json',
        PointBudget(points, frozenset(), 7, amount, {0: 1, 1: 1}, counts, {'a': SceneSize(N, 3, 1)}),
    )
    return Store(folder / 'budget.json', lambda: load_point_budget(folder / 'budget.json'))


def regions(folder):
    np.savez(folder / 'regions.npz', labels=np.arange(N) // 4)
    part = Precomputed(files=str(folder / '{scene}.npz'))
    cloud = PointCloud(np.ones((N, 3)))
    return Store(folder / 'regions.npz', lambda: part.partition(cloud, None, None, 'regions'))


STORES = {
    'labels': scene_labels, 'ledger': ledger, 'kept': kept, 'complete.json': complete, 'current.json': current,
    'cache': cache, 'clicks.csv': clicks('.csv'), 'clicks.json': clicks('.json'), 'clicks.jsonl': clicks('.jsonl'),
    'click log': click_log, 'checkpoint': checkpoint, 'newest checkpoint': newest_checkpoint,
    'config in a checkpoint': embedded_config, 'metrics.json': record, 'timing.json': times, 'settings.json': settings,
    'manifest': manifest, 'data.json': data_record, 'point budget': point_budget, 'regions': regions,
}  # fmt: skip


@pytest.fixture(autouse=True)
def without_shape_checks():
    """What the code itself says of wrong input is tested here."""
    config.update('jaxtyping_disable', True)
    yield
    config.update('jaxtyping_disable', False)


def written_damaged(path, good, rng):
    """Damage the bytes, or what they say."""
    if path.suffix == '.json' and path.parent.name != 'vis_data' and rng.random() < 0.6:  # that one has many values
        path.write_text(json.dumps(damaged_value(json.loads(good), rng)))
    elif path.suffix == '.npz' and path.stem != 'key' and rng.random() < 0.6:  # the cache trusts its hash
        path.write_bytes(good)
        try:
            write_npz(path, damaged_arrays(read_npz(path), rng))
        except UserError:  # a plain npz, without our hash
            with np.load(path) as arrays:
                changed = damaged_arrays(dict(arrays), rng)
            np.savez(path, **changed)
    else:
        path.write_bytes(damaged(good, rng))


@pytest.mark.parametrize('kind', STORES)
def test_what_was_written_or_a_message(tmp_path, kind):
    refused, store = 0, STORES[kind](tmp_path)
    good = store.path.read_bytes()
    store.read()  # whole; kernels are compiled
    for case in range(CASES):
        written_damaged(store.path, good, np.random.default_rng([case, len(kind)]))
        size, began = store.path.stat().st_size, time.process_time()
        tracemalloc.start()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter('ignore', UserWarning)
                store.read()
        except UserError as error:
            refused += 1
            assert store.path.name in str(error) or str(tmp_path) in str(error), (case, error)
        finally:
            peak = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
        assert peak < 4 * size + SLACK, (case, peak, size)
        assert time.process_time() - began < 5, case
    print(f'{kind}: {CASES} cases, {refused} refused')
