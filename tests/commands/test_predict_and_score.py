"""Commands after training: predict scans without labels, score a checkpoint, prepare geometry."""

import json
import re
import shutil

import numpy as np
import pytest
import torch
from runs import tiny_runs

from rm3d_plugin.datasets.box_formats import BOX_FORMATS
from rm3d_plugin.datasets.kitti_format import objects_to_boxes, read_calib, read_objects
from rm3d_plugin.storage.ply import write_ply
from rm3d_plugin.storage.scans import read_scan

CLASSES = ('Car', 'Pedestrian', 'Cyclist')


def boxes_of(path) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Classes, (K, 7) boxes and scores of a predicted JSON."""
    boxes = json.loads(path.read_text())['boxes']
    rows = [[*box['center'], *box['size'], box['yaw']] for box in boxes]
    return [box['class'] for box in boxes], np.array(rows), np.array([box['score'] for box in boxes])


def test_a_scan_without_labels_becomes_boxes_as_json_and_as_kitti_lines(call, trained, world, tmp_path):
    scans = tmp_path / 'drive' / 'velodyne'
    (tmp_path / 'drive' / 'calib').mkdir(parents=True)
    scans.mkdir()
    shutil.copy(world / 'training' / 'velodyne' / '000001.bin', scans / 'first.bin')
    shutil.copy(world / 'training' / 'velodyne' / '000000.bin', scans / 'second.bin')
    shutil.copy(world / 'training' / 'calib' / '000001.txt', tmp_path / 'drive' / 'calib' / 'first.txt')
    out = tmp_path / 'out'
    code, output = call('predict', checkpoint_of(trained), scans, '--out', out, '--min-score', '0.05')
    assert code == 0, output
    names = ['first.json', 'first.txt', 'second.json']
    assert sorted(path.name for path in out.iterdir()) == names
    assert [line for line in output.splitlines() if line.startswith(str(out))] == [str(out / name) for name in names]

    content = json.loads((out / 'first.json').read_text())
    assert content['scan'] == 'first.bin' and content['frame'].startswith('that of the scan file')
    kinds, boxes, scores = boxes_of(out / 'first.json')
    assert len(boxes) >= 3 and (scores >= 0.05).all() and (boxes[:, 3:6] > 0).all()
    calib = read_calib(tmp_path / 'drive' / 'calib' / 'first.txt')
    objects = read_objects(out / 'first.txt')
    same = objects_to_boxes(objects, calib, CLASSES)
    assert [item.type for item in objects] == kinds == [CLASSES[label] for label in same.labels]
    np.testing.assert_allclose(same.tensor[:, :6], boxes[:, :6], atol=0.02)  # two decimals in KITTI's lines
    assert np.abs(np.angle(np.exp(1j * (same.tensor[:, 6] - boxes[:, 6])))).max() < 0.006
    np.testing.assert_allclose(same.scores, scores, atol=1e-4)


def test_prediction_finds_the_very_boxes_that_validation_scores(call, trained, tmp_path):
    data = trained.parent / 'kitti'
    settings = tiny_runs.options(data, **tiny_runs.LEARNT, **{'val_evaluator.0.export_dir': str(tmp_path / 'lines')})
    code, output = call('test', *_with_checkpoint(tiny_runs.arguments_of(settings, tmp_path / 'scored'), trained))
    assert code == 0, output
    scans = data / 'training' / 'velodyne'
    code, output = call('predict', checkpoint_of(trained), scans, '--out', tmp_path / 'out', '--min-score', '0')
    assert code == 0, output
    for frame in ('000000', '000001', '000002'):
        scored = read_objects(tmp_path / 'lines' / f'{frame}.txt')
        found = read_objects(tmp_path / 'out' / f'{frame}.txt')
        in_image = [o for o in found if o.bbox[2] > o.bbox[0] and o.bbox[3] > o.bbox[1]]
        assert scored == in_image and len(scored) >= 3


def test_the_score_threshold_leaves_out_and_changes_nothing_else(call, trained, world, tmp_path):
    scan = world / 'training' / 'velodyne' / '000002.bin'

    def predict(name, least):
        code, output = call('predict', checkpoint_of(trained), scan, '--out', tmp_path / name, '--min-score', least)
        assert code == 0, output
        return boxes_of(tmp_path / name / '000002.json')

    kinds, boxes, scores = predict('all', 0)
    steps = np.sort(scores)
    gap = np.diff(steps).argmax()
    kept = scores > steps[gap]
    assert 0 < kept.sum() < len(kept)
    fewer = predict('some', (steps[gap] + steps[gap + 1]) / 2)
    assert fewer[0] == [kind for kind, keep in zip(kinds, kept, strict=True) if keep]
    np.testing.assert_array_equal(fewer[1], boxes[kept])


def test_any_scan_becomes_boxes_in_the_formats_of_labelling_tools(call, trained, world, tmp_path):
    cloud = read_scan(world / 'training' / 'velodyne' / '000002.bin').cloud
    columns = {axis: cloud.xyz[:, i] for i, axis in enumerate('xyz')}
    write_ply(tmp_path / 'with.ply', columns | {'intensity': cloud.intensity})
    write_ply(tmp_path / 'without.ply', columns)
    expected = {}
    for kind in ('json', 'openpcdet', 'labelcloud_rel', 'labelcloud_abs', 'labelcloud_vertices', 'sustech'):
        code, output = call(
            'predict', checkpoint_of(trained), tmp_path / 'with.ply', tmp_path / 'without.ply',
            '--out', tmp_path / kind, '--min-score', '0.02', '--format', kind,
        )  # fmt: skip
        assert code == 0, output
        files = sorted((tmp_path / kind).iterdir())
        found = {path.stem: BOX_FORMATS[kind].read(path, None) for path in files}
        assert len(found['with'].names) >= 3 and sorted(found) == ['with', 'without']
        for name, boxes in found.items():
            first = expected.setdefault(name, boxes)
            assert first.names == boxes.names
            np.testing.assert_allclose(boxes.tensor, first.tensor, atol=1e-3)


def test_a_format_that_does_not_fit_a_detector_is_told(call, trained, world, tmp_path):
    scan = tmp_path / 'alone.bin'
    shutil.copy(world / 'training' / 'velodyne' / '000002.bin', scan)
    for options, told in (
        (('--format', 'las'), '--format of a detector: expected one of openpcdet, kitti'),
        (('--chunk', '5'), 'finds boxes; chunk_size is for networks that classify points'),
        (('--format', 'kitti'), 'so each scan needs ../calib/NAME.txt'),
    ):
        code, output = call('predict', checkpoint_of(trained), scan, '--out', tmp_path / 'out', *options)
        assert code == 2 and told in output


def test_the_scoring_command_prints_what_training_found_last(call, trained, tmp_path):
    settings = tiny_runs.options(trained.parent / 'kitti', **tiny_runs.LEARNT)
    code, output = call('test', *_with_checkpoint(tiny_runs.arguments_of(settings, tmp_path / 'scored'), trained))
    assert code == 0, output
    record = json.loads((trained / 'metrics.json').read_text())
    assert json.loads((tmp_path / 'scored' / 'test_metrics.json').read_text()) == record['final']
    assert any(value > 0 for value in record['final'].values())
    for key, value in record['final'].items():
        match = re.fullmatch(r'Cyclist_3d_moderate_(R\d+)@(.*)', key)
        if match:
            start = rf'Cyclist +3d AP {match[1]} @ {match[2]}(, interpolated)? '
            (line,) = [x for x in output.splitlines() if re.match(start, x)][-1:]
            assert float(line.split()[-2]) == pytest.approx(value, abs=0.005)


def _with_checkpoint(arguments: list[str], run) -> list[str]:
    return [arguments[0], str(checkpoint_of(run)), *arguments[1:]]


def checkpoint_of(run):
    return max(run.glob('epoch_*.pth'), key=lambda path: int(path.stem.split('_')[1]))


def test_the_checkpoint_and_the_files_of_a_run(trained):
    state = torch.load(checkpoint_of(trained), weights_only=True)
    assert json.loads(state['meta']['config_json'])['widths'] == [8, 16]
    assert {'metrics.json', 'report.html', 'labels'} <= {path.name for path in trained.iterdir()}
    assert len(list(trained.glob('epoch_*.pth'))) == 2  # the newest two are kept


def test_preparing_fills_the_cache_that_training_reads_with_any_number_of_processes(call, world, tmp_path):
    caches = {jobs: tmp_path / f'cache{jobs}' for jobs in (1, 2)}
    for jobs, cache in caches.items():
        settings = tiny_runs.options(world, cache_dir=str(cache), rounds=1)
        code, output = call('prepare', *tiny_runs.arguments_of(settings, tmp_path / 'run'), '--jobs', str(jobs))
        assert code == 0, output
        assert f'geometry of 3 scenes is in {cache}' in output
    files = {path.name: path.read_bytes() for path in caches[1].iterdir()}
    assert len(files) == 3 and files == {path.name: path.read_bytes() for path in caches[2].iterdir()}
    before = {path.name: path.stat().st_mtime_ns for path in caches[2].iterdir()}
    code, output = call('train', *tiny_runs.arguments_of(settings, tmp_path / 'run'))
    assert code == 0, output
    assert {path.name: path.stat().st_mtime_ns for path in caches[2].iterdir()} == before
