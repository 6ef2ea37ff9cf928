"""Boundary table and robustness card on hand-made rooms; the commands themselves are run for the documentation."""

import csv
import dataclasses
from pathlib import Path

import numpy as np
import pytest
from reference.rooms import make_room

from rm3d_plugin.descriptors import FPFH, SuperpointGraph
from rm3d_plugin.engine.config import ConfigError, load_config
from rm3d_plugin.evaluation.functional.boundary import boundary_scores
from rm3d_plugin.experiments import Request, make_table, scenes
from rm3d_plugin.experiments.poses import POSES
from rm3d_plugin.experiments.render import to_markdown
from rm3d_plugin.experiments.run_commands import option_texts, parse_options
from rm3d_plugin.experiments.scenes import (
    Collection,
    TableScene,
    described_surface,
    load_collections,
    turned,
)
from rm3d_plugin.experiments.tables import descriptors_overseg
from rm3d_plugin.experiments.tables.descriptors_instance import CONFIG, instance_table
from rm3d_plugin.experiments.tables.descriptors_overseg import (
    Method,
    OversegScores,
    asked_methods,
    fill_overseg,
    measure_method,
)
from rm3d_plugin.experiments.tables.robustness_card import (
    LEVELS,
    CardRow,
    change_scene,
    change_scenes,
    compare,
    fill_card,
    measure_card,
)
from rm3d_plugin.ops.turns import random_turn, turn_about
from rm3d_plugin.oversegmentation import RegionGrowing
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.structures import Descriptors, PointCloud

SPG = Method('SuperpointGraph', 'SuperpointGraph')
SUPERVOXELS = Method('normals, VCCS divides', 'SuperpointGraph', 'VCCS', {'distance': 'pcl'})


@pytest.fixture(scope='module')
def rooms():
    made = []
    for seed in (0, 1):
        xyz, truth = make_room(density=120, seed=seed)
        made.append(TableScene(f'room {seed}', described_surface(PointCloud(xyz)), truth, truth))
    classes = int(max(scene.semantic.max() for scene in made)) + 1
    return Collection('toy', 'toy (synthetic)', 'indoor', classes, (made[0],), (made[1],))


def test_turns():
    np.testing.assert_allclose(turn_about((0.0, 0.0, 2.0), 90.0) @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(turn_about((1.0, 0.0, 0.0), 180.0) @ [0, 1, 2], [0, -1, -2], atol=1e-12)
    for kind in ('z', 'so3'):
        matrix = random_turn(kind, np.random.default_rng(3))
        np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(matrix) == pytest.approx(1) and (matrix[2, 2] == 1) == (kind == 'z')


@pytest.mark.parametrize('sensor', [None, (1.0, 2.0, 1.5)])
def test_a_turned_scene_has_turned_normals(rooms, sensor):
    cloud = described_surface(dataclasses.replace(rooms.scenes[0].cloud, sensor=sensor, normals=None, curvature=None))
    matrix = turn_about((1.0, 2.0, 3.0), 100.0)
    after = turned(cloud, matrix)
    np.testing.assert_allclose(after.xyz, cloud.xyz @ matrix.T, atol=1e-5)
    agree = np.einsum('ij,ij->i', after.normals.astype(float), cloud.normals @ matrix.T)
    assert (agree > 0.999).mean() > 0.99  # of the same sign, too
    np.testing.assert_allclose(after.curvature, cloud.curvature, atol=1e-3)
    assert sensor is None or np.allclose(after.sensor, matrix @ sensor)


def test_scores_are_those_of_the_tuned_parts(rooms):
    rows = [row for method in (SPG, SUPERVOXELS) for row in measure_method(method, rooms, seed=0)]
    assert [(row.method, row.pose) for row in rows] == [(m.title, pose) for m in (SPG, SUPERVOXELS) for pose in POSES]
    scene, first = rooms.scenes[0], rows[0]
    settings = dict(part.split() for part in first.settings.split(', '))
    assert set(settings) == {'theta', 'zeta'} and rows[3].settings.startswith('seed_size ')
    labels = [descriptors_overseg._annotated_labels(rooms.tuning[0], [0, 0])]
    parts = descriptors_overseg.tune_method(SPG, rooms, labels)
    described = SuperpointGraph().compute(scene.cloud)
    options = descriptors_overseg.options_for(parts, scene, described)
    assert options['zeta'] == parts.tuning.options['zeta']  # the counted value alone is set anew
    found = RegionGrowing(**options).segment(scene.cloud, described).labels
    scores = boundary_scores(scene.cloud.xyz, scene.semantic, found, rooms.classes, scene.objects)
    assert first[4:9] == pytest.approx(
        (scores.recall, scores.precision, scores.f1, scores.oracle_miou, scores.oracle_accuracy)
    )
    assert first.regions == scores.regions and first.points == len(scene.cloud) and first.scene == 'room 1'
    assert first.oracle_miou > 0.6 and abs(rows[1].f1 - first.f1) < 0.1  # eigenfeatures do not change about z
    assert 0.8 < first.regions / (len(scene.cloud) / 150) < 1.25


def test_rows_follow_from_the_registered_descriptors(monkeypatch):
    everything = Request(Path('out'))
    titles = [method.title for method in asked_methods(everything)]
    assert titles[:4] == ['VisualSimilarity', 'HKS', 'SIHKS', 'FPFH'] and 'AdaptedPFH' in titles
    monkeypatch.delitem(DESCRIPTORS.module_dict, 'FPFH')
    fewer = [method.title for method in asked_methods(everything)]
    assert set(titles) - set(fewer) == {'FPFH', 'FPFH, VCCS divides', 'normals, VCCS divides'}
    some = dataclasses.replace(everything, descriptors=['VCCS', 'SHOT'])
    assert [method.title for method in asked_methods(some)] == ['SHOT', 'VCCS']
    with pytest.raises(ConfigError, match='descriptors: expected some of VisualSimilarity, .*; got Moon'):
        asked_methods(dataclasses.replace(everything, descriptors=['Moon']))


def test_table_as_printed():
    rows = [
        OversegScores(
            'toy', 'FPFH', pose, scene, 0.5 + i / 10, 0.25, 1 / 3, 0.8, 0.9, 100 + more, 1.5, 0.25, 2500, 'theta 9'
        )
        for scene, more in (('a', 0), ('b', 20))
        for i, pose in enumerate(POSES)
    ]
    table = fill_overseg(rows, seed=4)
    lines = to_markdown(table).splitlines()
    assert '**toy: 2 scenes, 5000 points**' in lines and 'seed 4' in ' '.join(lines[:4])
    assert lines[-1] == (
        '| FPFH | 50.0 ± 0.0 / 60.0 ± 0.0 / 70.0 ± 0.0 | 25.0 ± 0.0 / 25.0 ± 0.0 / 25.0 ± 0.0 '
        '| 33.3 ± 0.0 / 33.3 ± 0.0 / 33.3 ± 0.0 | 80.0 ± 0.0 / 80.0 ± 0.0 / 80.0 ± 0.0 '
        '| 110 ± 14 / 110 ± 14 / 110 ± 14 | 1.50 + 0.25 |'
    )
    assert table.records[1]['pose'] == 'z' and table.records[1]['recall'] == 0.6 and len(table.records) == 6


def test_files_of_both_tables(rooms, tmp_path, monkeypatch):
    monkeypatch.setitem(scenes.COLLECTIONS, 'toy', lambda root, amount: rooms)
    monkeypatch.setattr(descriptors_overseg, 'DIVIDED', ())
    request = Request(tmp_path, data=['toy'], descriptors=['SuperpointGraph'], log=lambda line: None)
    for name in ('descriptors-overseg', 'robustness-card'):
        text = to_markdown(make_table(name, request))
        assert (tmp_path / f'{name}.md').read_text() == text
        assert (tmp_path / f'{name}.png').read_bytes().startswith(b'\x89PNG')
        assert (tmp_path / 'measured' / f'{name}_toy_SuperpointGraph.json').is_file()
    saved = list(csv.DictReader((tmp_path / 'descriptors-overseg.csv').read_text().splitlines()))
    assert [row['pose'] for row in saved] == list(POSES) and 0 < float(saved[0]['f1']) < 1
    lines = (tmp_path / 'robustness-card.csv').read_text().splitlines()
    assert len(lines) == 1 + sum(map(len, LEVELS.values()))


def test_changes_of_a_scene(rooms):
    cloud, rng = rooms.scenes[0].cloud, np.random.default_rng(0)
    kept = change_scene(cloud, 'points dropped', 80, rng)
    assert len(kept.rows) == round(0.2 * len(cloud)) and (np.diff(kept.rows) > 0).all()
    np.testing.assert_array_equal(kept.cloud.xyz, cloud.xyz[kept.rows])
    shaken = change_scene(cloud, 'noise', 5, rng)
    assert (shaken.cloud.xyz - cloud.xyz).std() == pytest.approx(0.005, rel=0.05)
    lean = change_scene(cloud, 'tilt', 180, rng)
    np.testing.assert_allclose(lean.cloud.xyz, cloud.xyz[:, [1, 0, 2]] * [1, 1, -1], atol=1e-5)
    flat = change_scene(cloud, 'turn about z', 90, rng)
    np.testing.assert_allclose(flat.cloud.xyz, cloud.xyz[:, [1, 0, 2]] * [-1, 1, 1], atol=1e-5)


def test_comparison_by_hand():
    before = Descriptors(np.float32([[1, 0], [0, 1], [3, 4], [0, 0]]), np.array([True, True, True, False]))
    after = Descriptors(np.float32([[2, 0], [3, 0], [0, 0]]), np.array([True, True, False]))
    found = compare(before, after, np.array([0, 2, 1]), [0])  # point 1 is lost, point 3 was dropped
    assert found.lost == 1 and sorted(found.same.tolist()) == pytest.approx([0.6, 1.0])
    assert len(found.other) == len(found.chance) == 2
    same = compare(before, before, np.arange(4), [0])
    np.testing.assert_allclose(same.same, 1)
    np.testing.assert_array_equal(same.other, same.chance)


def test_card_of_a_descriptor_that_does_not_turn(rooms):
    made = measure_card('SuperpointGraph', SuperpointGraph(), 'toy', lambda: change_scenes(rooms, 0), 0)
    rows = {(row.kind, row.level): row for row in made}
    assert list(rows) == [(kind, level) for kind, levels in LEVELS.items() for level in levels]
    assert rows['turn about z', 60.0].cosine > 0.999 and rows['turn about z', 60.0].own > 0.95
    assert rows['tilt', 60.0].cosine < 0.98  # verticality
    assert rows['noise', 10.0].cosine < rows['noise', 2.0].cosine
    assert rows['points dropped', 80.0].cosine < rows['points dropped', 50.0].cosine < 1


def test_card_as_printed():
    rows = [
        CardRow('toy', 'PFH', kind, level, 0.9 - level / 1000, 0.75, 0.4, 1.0, 10)
        for kind, levels in LEVELS.items()
        for level in levels
    ]
    line = to_markdown(fill_card(rows, 0)).splitlines()[-1]
    assert line == '| PFH | 0.72 (75) | 0.72 (75) | 0.85 (75) | 0.82 (75) | 0.90 (75) | 0.90 (75) | 0.89 (75) | 0.40 |'


def test_data_that_are_not_there(tmp_path, monkeypatch):
    monkeypatch.setenv('RM3D_REAL_DATA', str(tmp_path))
    told = []
    request = Request(tmp_path, data=['oakland', 'semantickitti'], scenes=1, log=told.append)
    assert load_collections(request) == []
    assert [line.split(':')[0] for line in told] == ['oakland', 'semantickitti'] and str(tmp_path) in told[0]
    with pytest.raises(ConfigError, match=r"data among rooms, .*got 1, None, \['moon'\]"):
        load_collections(dataclasses.replace(request, data=['moon']))
    with pytest.raises(ConfigError, match='nothing to measure'):
        make_table('robustness-card', request)


def test_real_scenes_are_read(real_data, monkeypatch, tmp_path):
    if not (real_data / 'oakland').is_dir():
        pytest.skip('no Oakland there')
    monkeypatch.setenv('RM3D_REAL_DATA', str(real_data))
    (collection,) = load_collections(Request(tmp_path, data=['oakland'], scenes=1, points=3000))
    assert len(collection.scenes) == 1 and collection.classes == 6 and 'real' in collection.title
    scene = collection.scenes[0]
    assert 3000 == len(scene.cloud) == len(scene.semantic) == len(scene.objects) and scene.cloud.curvature is not None
    assert not {scene.name for scene in collection.tuning} & {scene.name for scene in collection.scenes}


def test_table_2_has_each_budget_and_descriptor_twice():
    table = instance_table(['0p2pct', '1pct'], ['FPFH', 'SuperpointGraph'])
    assert [row.name for row in table.rows[:4]] == [
        'FPFH (0.2 %)', 'FPFH (0.2 %, turned)', 'SuperpointGraph (0.2 %)', 'SuperpointGraph (0.2 %, turned)',
    ]  # fmt: skip
    assert table.rows[4].name == 'FPFH (1 %)' and table.rows[4].options['budget'] == '1pct'
    options = parse_options(option_texts(table.rows[1].options))
    config = load_config(CONFIG, 'unused', demo=True, options=options)
    assert config.label_maker.descriptor == {'type': 'TurnedScene', 'base': {'type': 'FPFH', 'radius': 0.1}}
    assert config.label_maker.strategy == 'paper'
    assert isinstance(DESCRIPTORS.build(config.label_maker.descriptor).base, FPFH)
