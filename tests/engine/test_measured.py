"""What a config leaves to the data: from the annotated boxes alone, and told."""

import numpy as np
import pytest
from reference.harbour import make_harbour

from rm3d_plugin.engine.config import load_config
from rm3d_plugin.engine.measured import lengths_of, measure_boxes, unit_of
from rm3d_plugin.reporting.draw_labels import source_of
from rm3d_plugin.structures import SceneError

CONFIG = 'rm3d_votenet_files_boxes'


def config_of(world, tmp_path, **options):
    return load_config(
        CONFIG, tmp_path / 'run', options={'data_root': str(world), 'cache_dir': str(tmp_path), **options}
    )


@pytest.fixture
def world(tmp_path):
    return make_harbour(tmp_path / 'harbour')


def test_classes_sizes_range_and_lengths_follow_from_the_data(world, tmp_path):
    found = measure_boxes(config_of(world, tmp_path))
    options = found.options
    assert (options['classes'], options['num_classes'], options['unit']) == (['boat', 'buoy'], 2, 1.0)
    np.testing.assert_allclose(options['class_sizes'], [[4, 2, 2], [1, 1, 1]])
    assert options['near'] == [0.905, 0.32] and options['far'] == [1.81, 0.64] and options['radius'] == 1.358
    assert options['centre_distance'] == [1.358, 0.48, None] and options['class_gamma'] == [0.4, 0.4, 1.1]
    assert options['voxel_size'] == 0.1
    low, high = options['point_range'][:3], options['point_range'][3:]
    assert min(low) >= -22 and max(high) <= 22
    assert found.lines[0].startswith('Found in the data')
    assert any(line == '  class boat: 4 annotated boxes, median 4 x 2 x 2 m' for line in found.lines)
    resolved = config_of(world, tmp_path, **options)
    assert resolved.model.num_classes == 2 and resolved.model.vote_head.radius == 1.358
    for loader in ('train_dataloader', 'label_dataloader', 'val_dataloader'):
        assert resolved[loader].dataset.classes == ['boat', 'buoy']
        assert resolved[loader].dataset.point_range == options['point_range']


def test_what_the_user_says_wins(world, tmp_path):
    options = measure_boxes(config_of(world, tmp_path, voxel_size=0.3, classes=['buoy'])).options
    assert 'voxel_size' not in options and 'classes' not in options
    assert options['num_classes'] == 1 and options['class_sizes'] == [[1, 1, 1]]


def test_hidden_boxes_do_not_speak(world, tmp_path):
    options = {'budget': 'onebox', 'budget_seed': 3}
    before = measure_boxes(config_of(world, tmp_path, **options)).options
    annotated = source_of(config_of(world, tmp_path, **options)).budget.annotated
    for scene, rows in annotated.items():
        path = world / 'labels' / f'{scene}.txt'
        lines = path.read_text().splitlines()
        hidden = [line.replace('.000000', '.300000') for line in lines]  # other sizes and places
        path.write_text('\n'.join(line if i in rows else hidden[i] for i, line in enumerate(lines)))
    assert measure_boxes(config_of(world, tmp_path, **options)).options == before


def test_boxes_that_never_turn_are_learnt_along_the_axes(world, tmp_path):
    turning = config_of(world, tmp_path, **measure_boxes(config_of(world, tmp_path)).options)
    assert turning.model.vote_head.heading_bins == 12
    assert turning.train_dataloader.dataset.pipeline[0].type == 'LabelledObjectPaste'
    for path in (world / 'labels').glob('*.txt'):
        path.write_text(path.read_text().replace('0.300000 boat', '0.000000 boat'))
    aligned = config_of(world, tmp_path, **measure_boxes(config_of(world, tmp_path)).options)
    assert aligned.model.vote_head.heading_bins == 1
    (hook,) = [hook for hook in aligned.custom_hooks if hook.type == 'RegionMergeHook']
    assert hook.label_maker.objects.box == 'axis_aligned'
    (turned,) = [step for step in aligned.train_dataloader.dataset.pipeline if step.type == 'GlobalRotScale']
    assert turned.rot == [0, 0]


def test_large_and_small_things_get_a_unit():
    assert unit_of(np.array([[36.0, 8.6, 15.0]])) == 7.0
    assert unit_of(np.array([[0.02, 0.016, 0.01]])) == 0.0072
    assert unit_of(np.array([[0.6, 0.6, 0.8], [3.9, 1.6, 1.5]])) == 1.0


def test_lengths_of_cars_are_those_of_kitti():
    cars = lengths_of(np.array([[3.9, 1.6, 1.56]]))
    found = [cars['near'][0], cars['far'][0], cars['radius'], cars['centre_distance'][0], cars['voxel_size']]
    np.testing.assert_allclose(found, [0.8, 1.6, 1.2, 1.2, 0.16], rtol=0.01)


def test_without_any_box_it_says_what_to_do(world, tmp_path):
    for path in (world / 'labels').glob('*.txt'):
        path.write_text('')
    with pytest.raises(SceneError, match='no class is found, as no file of boxes holds any; label a few objects'):
        measure_boxes(config_of(world, tmp_path))
