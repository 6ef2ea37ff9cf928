"""Rounds are whole or not there; every reader sees the current one."""

import os

import numpy as np
import pytest

from rm3d_plugin.storage import DamagedFileError, LabelStore, LabelStoreError, read_npz, write_npz
from rm3d_plugin.structures import Boxes3D, PseudoLabels


def labels(value=0, points=4, true_boxes=1):
    boxes = Boxes3D(
        np.array([[1.0, 2, 3, 4, 2, 1, 0.1], [0.0, 0, 0, 1, 1, 1, -3.0]]), np.array([0, 2]), np.array([1, 0.1 + 0.2])
    )
    return PseudoLabels(
        semantic=np.full(points, value),
        instance=np.arange(points) - 1,
        point_is_annotated=np.arange(points) < 2,
        confidence=np.linspace(0, 1, points, dtype=np.float32),
        boxes=boxes,
        box_is_annotated=np.arange(2) < true_boxes,
    )


def write_round(store, number, value, scenes=('a', 'b')):
    store.begin_round(number)
    for scene in scenes:
        store.write(number, scene, labels(value))
    store.finish_round(number, {'coverage': 0.5})


@pytest.fixture
def store(tmp_path):
    return LabelStore(tmp_path / 'store')


@pytest.mark.parametrize('complete', [False, True])
def test_labels_come_back_bit_for_bit(store, complete):
    given = labels(3)
    likeliest = np.arange(len(given)) if complete else None
    given = PseudoLabels(**{**given.__dict__, 'complete': complete, 'likeliest': likeliest})
    store.begin_round(0)
    store.write(0, 'Area_1/office 2', given, {'score': np.array([0.1])})
    store.finish_round(0)
    read = store.read('Area_1/office 2', round=0)
    for name in ('semantic', 'instance', 'point_is_annotated', 'confidence', 'box_is_annotated'):
        np.testing.assert_array_equal(getattr(read, name), getattr(given, name), strict=True)
    for name in ('tensor', 'labels', 'scores'):
        np.testing.assert_array_equal(getattr(read.boxes, name), getattr(given.boxes, name), strict=True)
    assert read.complete is complete and (read.likeliest is None) != complete
    np.testing.assert_array_equal(read.likeliest, likeliest)
    assert store.read_ledger('Area_1/office 2', round=0)['score'].tolist() == [0.1]
    assert store.scenes(0) == {'Area_1/office 2': (4, 1)}


def test_a_scene_without_points_or_boxes(store):
    none = np.zeros(0, dtype=np.int64)
    empty = PseudoLabels(none, none, none > 0, np.zeros(0, np.float32), Boxes3D.empty(), none > 0)
    store.begin_round(0)
    store.write(0, 's', empty)
    store.finish_round(0)
    assert len(store.read('s', 0)) == 0
    assert len(store.read('s', 0).boxes) == 0


def test_readers_follow_current_at_each_call(store):
    write_round(store, 0, 5)
    write_round(store, 1, 6)
    reader = LabelStore(store.root)
    assert reader.current_round() is None
    store.set_current(0)
    assert reader.current_round() == 0
    assert reader.read('a').semantic.tolist() == [5] * 4
    store.set_current(1)
    assert reader.read('a').semantic.tolist() == [6] * 4
    assert reader.read('a', round=0).semantic.tolist() == [5] * 4
    assert reader.rounds() == (0, 1)
    assert reader.summary() == {'coverage': 0.5}


def test_a_half_written_round_is_no_round_and_is_removed(store):
    write_round(store, 0, 5)
    store.begin_round(1)
    store.write(1, 'a', labels(6))
    assert store.rounds() == (0,)
    assert store.read('a', 1).semantic.tolist() == [6] * 4  # whoever writes the round may look at it
    for read in (lambda: store.read('b', 1), lambda: store.set_current(1), lambda: store.scenes(1)):
        with pytest.raises(LabelStoreError, match=r'round 1 is absent or half-written \(complete rounds: \[0\]\)'):
            read()
    store.begin_round(1)
    assert not store.scene_path(1, 'a').exists()


def test_killed_between_rounds_the_old_round_stays(store):
    write_round(store, 0, 5)
    store.set_current(0)
    child = os.fork()
    if child == 0:
        store.begin_round(1)
        store.write(1, 'a', labels(6))
        os._exit(9)
    os.waitpid(child, 0)
    assert store.current_round() == 0
    assert store.read('a').semantic.tolist() == [5] * 4
    write_round(store, 1, 7)
    store.set_current(1)
    assert store.read('a').semantic.tolist() == [7] * 4


def test_a_complete_round_is_kept_unless_asked(store):
    write_round(store, 0, 5)
    store.set_current(0)
    with pytest.raises(LabelStoreError, match='round 0 is complete; use it'):
        store.begin_round(0)
    with pytest.raises(LabelStoreError, match='round 0 is complete; call begin_round'):
        store.write(0, 'c', labels())
    store.begin_round(0, overwrite=True)
    assert store.current_round() is None
    assert store.rounds() == ()


def test_errors_say_what_to_do(store):
    with pytest.raises(LabelStoreError, match='no current round.*label the training scenes first'):
        store.read('a')
    with pytest.raises(LabelStoreError, match='was not begun; call begin_round'):
        store.write(0, 'a', labels())
    store.begin_round(0)
    with pytest.raises(LabelStoreError, match='holds no scene'):
        store.finish_round(0)
    store.write(0, 'a', labels())
    store.finish_round(0)
    store.set_current(0)
    with pytest.raises(LabelStoreError, match=r'scene b, round 0: no labels at .*b\.npz; the round holds 1 other'):
        store.read('b')
    with pytest.raises(LabelStoreError, match='scene a, round 0: no ledger'):
        store.read_ledger('a')
    with pytest.raises(ValueError, match='count from 0'):
        store.read('a', -1)


def test_damage_is_named(store):
    write_round(store, 0, 5)
    store.set_current(0)
    path = store.scene_path(0, 'a')
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(DamagedFileError, match=r'round_000/a\.npz'):
        store.read('a')
    write_npz(path, {'semantic': np.zeros(3), 'format': np.array(2)})
    with pytest.raises(DamagedFileError, match='a.npz: is not labels of scene a, round 0'):
        store.read('a')


@pytest.mark.parametrize('content', ['[]', '{"round": "0"}', '{"round": 1, "sha256": "0"}', '', '\0\0'])
def test_a_damaged_current_file_gives_way_to_the_last_complete_round(store, content):
    store.root.mkdir()
    (store.root / 'current.json').write_text(content)
    with pytest.raises(DamagedFileError, match=r'current\.json: '):
        store.current_round()
    for number in (0, 1):
        write_round(store, number, 5)
    with pytest.warns(UserWarning, match=r'current\.json: .*Round 1, the last complete one, is read'):
        assert store.current_round() == 1


def test_files_of_another_format_are_refused(store):
    write_round(store, 0, 5)
    path = store.scene_path(0, 'a')
    now = read_npz(path)
    for old in ({k: v for k, v in now.items() if k != 'format'}, now | {'format': np.array(1)}):
        write_npz(path, old)
        with pytest.raises(
            LabelStoreError, match=r'a\.npz: has format 1, this version reads 2; train again in another'
        ):
            store.read('a', 0)


def test_what_is_kept_outlasts_rounds_and_is_replaced(store):
    assert store.read_kept('region_prior', 'a/b') is None
    for value in (1.0, 2.0):
        store.keep('region_prior', 'a/b', {'prior': np.full((2, 3), value)})
        assert store.read_kept('region_prior', 'a/b')['prior'].tolist() == [[value] * 3] * 2
    store.begin_round(0)
    store.begin_round(0, overwrite=True)
    assert store.read_kept('region_prior', 'a/b') is not None and store.read_kept('other', 'a/b') is None


def test_finishing_checks_every_file(store):
    store.begin_round(0)
    store.write(0, 'a', labels())
    path = store.scene_path(0, 'a')
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(DamagedFileError, match=r'a\.npz'):
        store.finish_round(0)
    assert not store.is_complete(0)


def test_scene_names_cannot_leave_the_folder(store):
    store.begin_round(0)
    for name in ('../../x', '..', '/etc/x', 'complete', 'a%2Fb', 'a/b'):
        assert store.scene_path(0, name).parent == store.folder(0)
        store.write(0, name, labels())
    store.finish_round(0)
    assert set(store.scenes(0)) == {'../../x', '..', '/etc/x', 'complete', 'a%2Fb', 'a/b'}


def test_rounds_that_are_to_be_made_again_are_forgotten(store):
    for number in range(4):
        write_round(store, number, number)
    store.set_current(3)
    store.forget_rounds(2)
    assert store.rounds() == (0, 1) and store.current_round() == 1
    assert store.read('a').semantic.tolist() == [1] * 4
    with pytest.raises(LabelStoreError, match=r'round_002.*missing'):
        store.read('a', 2)
    store.forget_rounds(2)
    with pytest.raises(LabelStoreError, match='round 4 is absent or half-written'):
        store.forget_rounds(5)
