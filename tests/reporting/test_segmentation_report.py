"""The page that a segmentation run leaves, and how its scenes are gathered."""

import base64
import json
import re
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from reference.toy_scenes import CLASSES, ToyRooms
from runs import tiny_runs, toy_runs
from visualization.test_report import Reader

from rm3d_plugin.pseudo_labels.common.ledger import extreme_merges
from rm3d_plugin.regions import MergeLedger
from rm3d_plugin.reporting.scenes import (
    SceneRecord,
    own_colors,
    point_classes,
    point_instances,
    scene_from_above,
    scene_view,
    views_of,
)
from rm3d_plugin.storage import LabelStore
from rm3d_plugin.structures import PointCloud


def train_with_report(folder: Path) -> None:
    """A toy run with two validations and a report."""
    plain = toy_runs.config_of

    def config_of(work_dir, budget, dataset='ToyRooms', region_prior=False):
        config = plain(work_dir, budget, dataset, region_prior)
        config.val_dataloader = dict(
            batch_size=1,
            num_workers=0,
            collate_fn=dict(type='pseudo_collate'),
            sampler=dict(type='DefaultSampler', shuffle=False),
            dataset=dict(type=dataset, count=2, split='val', labels='truth', pipeline=[dict(type='PackScene')]),
        )
        config.val_cfg = dict(type='ValLoop')
        config.val_evaluator = [
            dict(type='SemSegMetric'),
            dict(type='InstanceSegMetric', instance_classes=[1], min_points=10),
        ]
        config.custom_hooks.append(dict(type='ReportHook', train_scenes=1, val_scenes=1))
        return config

    toy_runs.config_of = config_of
    toy_runs.train(folder)


class Left(NamedTuple):
    """What the run left."""

    folder: Path
    page: str
    final: dict
    views: dict


@pytest.fixture(scope='module')
def left(tmp_path_factory) -> Left:
    folder = tmp_path_factory.mktemp('reported') / 'run'
    code, log = tiny_runs.run(folder.with_suffix('.txt'), partial(train_with_report, folder))
    assert code == 0, log
    page = (folder / 'report.html').read_text()
    data = re.search(r'<script type="application/json" id="view-data">(.*?)</script>', page, re.DOTALL)[1]
    final = json.loads((folder / 'metrics.json').read_text())['final']
    return Left(folder, page, final, json.loads(data))


def test_the_page_tells_scores_labels_and_budget(left):
    rows = Reader(re.sub(r'<script.*?</script>', '', left.page, flags=re.DOTALL)).rows
    assert ['Class', 'IoU', 'AP', 'AP50', 'AP25'] in rows
    for name in CLASSES:
        expected = left.final.get(f'IoU_{name}')
        row = next(r for r in rows if r[0] == name and len(r) == 5)
        assert row[1] == ('–' if expected is None else f'{expected:.2f}')
    store = LabelStore(left.folder / 'labels')
    first, second = (store.summary(number) for number in (0, 1))
    row = next(r for r in rows if r[0] == 'all' and len(r) == 9)
    assert row[2:4] == [f'{100 * first["coverage"]:.1f} %', f'{100 * first["precision"]:.1f} %']
    assert row[6:9] == [
        *(f'{100 * second[k]:.1f} %' for k in ('coverage', 'precision')),
        f'{second["offset_error"]:.2f}',
    ]
    budget = json.loads((left.folder / 'labels' / 'budget.json').read_text())
    assert budget['hash'] in left.page and ['all', '15'] in [r[:2] for r in rows]
    for title in ('Training loss, the sum', 'Validation scores', 'Pseudo labels', 'Offset error of pseudo instances'):
        assert f'<figcaption>{title}</figcaption>' in left.page
    assert left.page.count('data:image/png;base64,') == 2


def test_the_page_needs_no_network_and_is_small(left):
    assert len(left.page) < 10_000_000
    rest = re.sub(r'base64,[\w+/=]+', '', re.sub(r'<script type="application/json".*?</script>', '', left.page))
    assert not re.search(r'https?:|@import|url\(|(src|href)\s*=\s*["\']?//', rest)
    assert rest.count('<script>') == 1 and '<link' not in rest and '<iframe' not in rest


def test_the_scenes_to_turn_are_those_of_the_run(left):
    training, validation = left.views['scenes']
    names = [layer['name'] for layer in training['layers']]
    kept = ['colour', 'regions', 'labels 0', 'labels 1', 'prediction', 'truth', 'found instances', 'true instances']
    assert names == kept
    assert [layer['name'] for layer in validation['layers']] == [kept[0], *kept[4:]]
    assert [c['name'] for c in left.views['classes']] == list(CLASSES)
    scene = training['title'].split()[-1]
    dataset, store = ToyRooms(), LabelStore(left.folder / 'labels')
    index = dataset.scene_ids.index(scene)
    layers = {layer['name']: base64.b64decode(layer['data']) for layer in training['layers']}
    assert training['count'] == training['total'] == len(dataset.load_cloud(index))
    for number in (0, 1):
        shown = np.frombuffer(layers[f'labels {number}'], 'u1').astype(int)
        np.testing.assert_array_equal(np.where(shown == 255, -1, shown), store.read(scene, number).semantic)
    truth = np.frombuffer(layers['truth'], 'u1').astype(int)
    np.testing.assert_array_equal(np.where(truth == 255, -1, truth), dataset.load_truth(index).semantic)
    marked = np.frombuffer(base64.b64decode(training['marked']), '<u4')
    np.testing.assert_array_equal(marked, np.flatnonzero(store.read(scene, 1).point_is_annotated))
    q = np.frombuffer(base64.b64decode(training['xyz']), '<u2').reshape(-1, 3)
    xyz = np.array(training['low']) + np.array(training['step']) * q
    np.testing.assert_allclose(xyz, dataset.load_cloud(index).xyz, atol=1e-4)


def test_the_merges_are_the_ledgers_extremes(left):
    store = LabelStore(left.folder / 'labels')
    best, pairs = [], 0
    for scene in store.scenes(1):
        ledger = MergeLedger.from_arrays(store.read_ledger(scene, 1))
        found = extreme_merges(ledger, 8)
        best += [(-found.margin[r], scene, ledger.region_a[r], ledger.region_b[r]) for r in found.strongest]
        pairs += len(ledger)
    rows = Reader(re.sub(r'<script.*?</script>', '', left.page, flags=re.DOTALL)).rows
    assert f'of {pairs:,} pairs'.replace(',', '&thinsp;') in left.page
    if best:
        _, scene, a, b = min(best)
        assert [scene, f'{a} + {b}'] in [row[:2] for row in rows]


def test_rows_that_the_network_saw_go_to_their_points():
    probabilities = np.array([[0.2, 0.8], [0.9, 0.1], [np.nan, np.nan]], dtype=np.float32)
    np.testing.assert_array_equal(point_classes(probabilities, np.array([3, 0, 1]), 5), [0, -1, -1, 1, -1])
    np.testing.assert_array_equal(point_classes(probabilities, None, 3), [1, 0, -1])
    np.testing.assert_array_equal(point_classes(np.zeros((0, 2), np.float32), np.zeros(0, int), 2), [-1, -1])


def test_of_two_instances_the_surer_one_has_the_point():
    masks = np.array([[1, 1, 0, 0], [0, 1, 1, 0], [0, 1, 0, 0]], dtype=bool)
    found = point_instances(masks, np.array([0.9, 0.5, 0.7]), np.array([4, 3, 2, 0]), 5)
    np.testing.assert_array_equal(found, [-1, -1, 1, 0, 0])
    assert (point_instances(np.zeros((0, 2), bool), np.zeros(0), None, 2) == -1).all()


def test_clouds_without_colour_are_grey_by_intensity_or_height():
    xyz = np.array([[0, 0, 0], [0, 0, 1], [0, 0, 2]], dtype=np.float32)
    grey = own_colors(PointCloud(xyz))
    assert (np.diff(grey, axis=0) > 0).all() and (grey == grey[:, :1]).all() and 0 <= grey.min() <= grey.max() <= 1
    by_return = own_colors(PointCloud(xyz, intensity=np.array([1.0, 0.5, 0.0])))
    assert (np.diff(by_return, axis=0) < 0).all()
    assert own_colors(PointCloud(np.zeros((0, 3)))).shape == (0, 3)
    colored = PointCloud(xyz, colors=np.eye(3))
    np.testing.assert_array_equal(own_colors(colored), np.eye(3))


def test_a_ceiling_is_left_out_from_above_and_cut_in_the_view():
    xyz = np.random.default_rng(0).uniform(0, 3, (60, 3)).astype(np.float32)
    truth = np.repeat([0, 1], 30)
    scene = SceneRecord('s', PointCloud(xyz), truth=truth)
    bare = SceneRecord('s', PointCloud(xyz[:30]), truth=truth[:30])
    classes = ('floor', 'ceiling')
    assert scene_from_above(scene, classes).png == scene_from_above(bare, classes).png
    assert scene_from_above(scene, ('floor', 'wall')).png != scene_from_above(bare, ('floor', 'wall')).png
    assert views_of([scene], classes)['cut'] < 1 and views_of([scene], ('floor', 'wall'))['cut'] == 1.0
    assert views_of([], classes) is None
    assert [layer.name for layer in scene_view(scene).layers] == ['colour', 'truth']
    scene_from_above(SceneRecord('s', PointCloud(xyz)), classes)
