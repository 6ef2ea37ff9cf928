"""``--demo`` changes data, sizes and epochs, never the method."""

from collections.abc import Mapping

import pytest
from configs.leaves import LEAVES, has_demo
from mmengine.config import Config

from rm3d_plugin.engine.config import load_config
from rm3d_plugin.engine.config_files import pages_merge, shipped_bases
from rm3d_plugin.engine.hooks import RegionMergeHook

DATA = {'data_root', 'demo_data', 'train_sequences', 'val_sequences', 'every'}
SIZES = {
    'crop_points',
    'recent_scenes',  # kept in memory
    'voxel_size',
    'widths',
    'blocks',
    'hidden',
    'num_seeds',
    'num_proposals',
    'batch_size',
    'num_workers',  # processes that read; the numbers are the same
}
# Lengths that follow the distance between points: the virtual lidar has half as many points a turn as KITTI's, and the
# virtual camera leaves a point each 4 cm, where real rooms have one each 1 to 2 cm.
DENSITY = {
    'oversegmenter.max_edge',
    'oversegmenter.range_growth',
    'cluster_radius',
    'cluster_points',
    'min_proposal_points',
}
# How long and how fast: rounds that the first and the last labels last are so many epochs, too; a schedule keeps its
# kind.
EPOCHS = {
    'rounds',
    'sigma',
    'warm_up_rounds',
    'final_rounds',
    'periods',
    'restart_weights',
    'learning_rate',
    'val_rounds',
    'checkpoint_interval',
}
MAY_CHANGE = DATA | SIZES | DENSITY | EPOCHS
METHOD = (
    'strategy propagation region_prior ground self_training objects losses propagate region_seeds descriptor budget '
    'graph_neighbors max_gap paste_objects unlabelled_weight tta_rotations superpoint_smoothing logit_adjustment task'
).split()

DEMOS = [path for path in LEAVES if has_demo(path)]
EACH = pytest.mark.parametrize('path', DEMOS, ids=lambda path: path.stem)


def leaf_keys(values, prefix=''):
    """Dotted keys of the values within nested dicts; data are one."""
    for key, value in values.items():
        if isinstance(value, Mapping) and key not in DATA:
            yield from leaf_keys(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}'


@EACH
def test_a_demo_touches_nothing_else(path):
    with shipped_bases(), pages_merge():
        demo = Config.fromfile(path).demo
    assert set(leaf_keys(demo)) <= MAY_CHANGE


def pipelines(config):
    """Every step of every pipeline, without sizes."""
    loaders = (config.train_dataloader, config.label_dataloader, config.val_dataloader)
    steps = [dict(step) for loader in loaders for step in loader.dataset.pipeline]
    return [{key: value for key, value in step.items() if key not in ('max_points', 'recent')} for step in steps]


@EACH
def test_the_method_of_a_demo_is_that_of_the_full_run(path):
    full, demo = load_config(path, 'run'), load_config(path, 'run', demo=True)
    for key in METHOD:
        assert without_lengths(full.get(key)) == without_lengths(demo.get(key)), key
    assert pipelines(full) == pipelines(demo)
    assert [step.type for step in full.param_scheduler] == [step.type for step in demo.param_scheduler]
    assert {**full['merge'], 'rounds': 0} == {**demo['merge'], 'rounds': 0}
    assert set(_changes(full.oversegmenter, demo.oversegmenter)) <= {'max_edge', 'range_growth'}


def without_lengths(value):
    """Without widths, and without how proposals are clustered, which follows the distance between points."""
    if isinstance(value, Mapping):
        sizes = ('proposals', 'in_channels', 'channels')
        return {key: without_lengths(part) for key, part in value.items() if key not in sizes}
    return [without_lengths(part) for part in value] if isinstance(value, list) else value


def _changes(one, other):
    return [key for key in {**one, **other} if one.get(key) != other.get(key)]


class Nothing:
    """A label maker that is never asked."""


@EACH
@pytest.mark.parametrize('demo', [False, True], ids=['', 'demo'])
def test_the_weights_of_merging_run_their_whole_way(path, demo):
    config = load_config(path, 'run', demo)
    hook = RegionMergeHook(
        config.sigma, Nothing(), None, rounds=config.label_refreshes, warm_up_rounds=config.warm_up_rounds
    )
    made = sorted({hook._round_of(epoch) for epoch in range(config.epochs)})
    assert made == list(range(config.label_refreshes)) and config['merge'].rounds == len(made)
    if path.stem.startswith('rm3d_') or config.label_refreshes > 1:
        assert (made[-1] / config['merge'].rounds) >= 2 / 3, 'y4 of the last labels'
