import numpy as np
import pytest
from reference.rooms import make_room

from rm3d_plugin.descriptors import SuperpointGraph
from rm3d_plugin.oversegmentation import RegionGrowing
from rm3d_plugin.oversegmentation.tuning import (
    Score,
    Trial,
    bisect_count,
    choose_trial,
    score_regions,
    tune_options,
    tune_region_growing,
)
from rm3d_plugin.regions.prepare import with_normals
from rm3d_plugin.structures import Descriptors, PointCloud


def test_conflicts_by_hand():
    regions = np.array([0, 0, 0, 0, 1, 1, 2, -1, -1])
    labels = np.array([3, 3, 5, -1, 2, 4, 1, 0, 1])
    # region 0: one 5 among two 3; region 1: 2 against 4, one of them is wrong; region 2 agrees; -1 does not count
    assert score_regions(regions, labels) == Score(regions=3, conflicts=2, labelled=6)
    assert score_regions(np.full(4, -1), np.zeros(4, int)) == Score(0, 0, 0)
    assert score_regions(np.zeros(0, int), np.zeros(0, int)) == Score(0, 0, 0)
    assert score_regions(np.zeros(3, int), np.full(3, -1)) == Score(1, 0, 0)
    with pytest.raises(ValueError, match='3 points, but 2'):
        score_regions(np.zeros(3, int), np.zeros(2, int))


def test_bisection_meets_the_count():
    tried = bisect_count(lambda value: round(1000 / value), 1.0, 100.0, target=50, steps=12)
    assert abs(1000 / tried[-1] - 50) < 1 and len(tried) <= 12
    assert tried[0] == pytest.approx(10.0)
    assert bisect_count(lambda value: 7, 1.0, 100.0, target=7) == [pytest.approx(10.0)]


def test_least_conflicts_among_those_at_the_target():
    trials = [
        Trial({'a': 1}, Score(1000, 0, 50)),  # far from the target
        Trial({'a': 2}, Score(110, 4, 50)),
        Trial({'a': 3}, Score(90, 2, 50)),
        Trial({'a': 4}, Score(99, 2, 50)),  # as few conflicts, nearer
        Trial({'a': 5}, Score(99, 2, 50)),
    ]
    assert choose_trial(trials, target=100).options == {'a': 4}
    assert choose_trial(trials, target=10).options == {'a': 3}  # nobody is near: the nearest
    with pytest.raises(ValueError, match='nothing was tried'):
        choose_trial([], 3)


def test_options_are_tried_for_each_choice_of_the_others():
    asked = []

    def score_of(options):
        asked.append(dict(options))
        return Score(round(100 / options['size']), 1 if options['other'] == 1 else 9, 20)

    tuning = tune_options(score_of, 'size', (1.0, 100.0), 25, [{'other': 0}, {'other': 1}], steps=8)
    assert tuning.options['other'] == 1 and tuning.options['size'] == pytest.approx(4, rel=0.1)
    assert tuning.score == Score(25, 1, 20) and tuning.target == 25
    assert [trial.options for trial in tuning.trials] == asked
    with pytest.raises(ValueError, match='target >= 1'):
        tune_options(score_of, 'size', (1.0, 2.0), 0)


def stripes(widths=(20, 20, 20, 20), step=20.0):
    """Strips of a plane whose normals turn by ``step`` degrees from one to the next: planted regions.

    Curvature is that of a plane, so zeta has no say; the descriptor is the same everywhere.
    """
    grid = np.stack(np.meshgrid(np.arange(30), np.arange(sum(widths)), indexing='ij'), axis=-1).reshape(-1, 2)
    truth = np.searchsorted(np.cumsum(widths), grid[:, 1], side='right')
    angle = np.deg2rad(step) * truth
    normals = np.stack([np.zeros_like(angle), np.sin(angle), np.cos(angle)], axis=1)
    xyz = np.c_[grid * 0.05, np.zeros(len(grid))]
    cloud = PointCloud(xyz, normals=normals, curvature=np.zeros(len(xyz)))
    return cloud, Descriptors(np.zeros((len(xyz), 2), np.float32), np.zeros(len(xyz), bool)), truth


def test_planted_strips_are_found():
    """Angles under 20 degrees keep four strips apart, larger ones make a single region."""
    cloud, nothing, truth = stripes()
    annotated = np.full(len(truth), -1)
    annotated[::97] = truth[::97]
    tuning = tune_region_growing([cloud], [nothing], [annotated], target_regions=4)
    assert tuning.score == Score(4, 0, (annotated >= 0).sum())
    assert 3 < tuning.options['theta'] < 20
    labels = RegionGrowing(**tuning.options).segment(cloud, nothing).labels
    assert all(len(np.unique(labels[truth == k])) == 1 for k in range(4)) and labels.max() == 3
    collapsed = tuning.trials[0]  # sqrt(3 * 60) = 13 degrees separates; conflicts rise only where strips run together
    assert collapsed.score.conflicts == 0
    wide = tune_region_growing([cloud], [nothing], [annotated], 1)
    assert wide.options['theta'] > 20 and wide.score.conflicts > 0


def test_zeta_is_chosen_by_the_labels():
    """Two flat pieces with a curved band between: only a small zeta stops there, and the number of regions is equal."""
    grid = np.stack(np.meshgrid(np.arange(30), np.arange(60), indexing='ij'), axis=-1).reshape(-1, 2)
    band = (grid[:, 1] >= 28) & (grid[:, 1] < 32)
    cloud = PointCloud(
        np.c_[grid * 0.05, np.zeros(len(grid))],
        normals=np.tile([0.0, 0, 1], (len(grid), 1)),
        curvature=np.where(band, 0.03, 0.0),
    )
    nothing = Descriptors(np.zeros((len(grid), 1), np.float32), np.zeros(len(grid), bool))
    annotated = np.full(len(grid), -1)
    annotated[::50] = (grid[::50, 1] >= 30) * 1
    tuning = tune_region_growing([cloud], [nothing], [annotated], 2, zetas=(0.1, 0.01), steps=2)
    assert tuning.options['zeta'] == 0.01 and tuning.score.conflicts <= 1
    assert tuning.trials[0].score.regions == 1 and tuning.trials[0].score.conflicts > 5


def test_the_same_input_gives_the_same_result_and_labels_matter_not_by_name():
    xyz, truth = make_room(density=150)
    cloud = with_normals(PointCloud(xyz))
    described = SuperpointGraph(k=20).compute(cloud)
    annotated = np.full(len(truth), -1)
    rows = np.random.default_rng(0).choice(len(truth), 60, replace=False)
    annotated[rows] = truth[rows]
    found = [tune_region_growing([cloud], [described], [annotated], 40, zetas=(0.01, 0.02), steps=4) for _ in range(2)]
    renamed = tune_region_growing(
        [cloud], [described], [np.where(annotated >= 0, 50 - annotated, -1)], 40, None, (0.01, 0.02), steps=4
    )
    assert found[0] == found[1] == renamed
    assert abs(np.log(found[0].score.regions / 40)) < np.log(1.6)
    assert found[0].score.conflicts <= 3


def test_ground_is_taken_off_first():
    rng = np.random.default_rng(0)
    floor = np.c_[rng.uniform(-8, 8, (4000, 2)), rng.normal(-1.7, 0.005, 4000)]
    box = rng.uniform(0, 1, (500, 3)) * [0.05, 1.5, 1.5] + [5, 0, -1.2]
    cloud = PointCloud(np.concatenate([floor, box]), sensor=(0.0, 0.0, 0.0))
    nothing = Descriptors(np.zeros((len(cloud), 1), np.float32), np.zeros(len(cloud), bool))
    annotated = np.zeros(len(cloud), int)
    tuning = tune_region_growing(
        [cloud], [nothing], [annotated], 3, {'ground': {}, 'zeta': 9.0, 'max_edge': 0.3}, steps=2
    )
    assert tuning.score.labelled < 1200 and max(trial.options['zeta'] for trial in tuning.trials) < 1


def test_input_that_cannot_be_used():
    cloud, nothing, truth = stripes()
    with pytest.raises(ValueError, match='no point is labelled'):
        tune_region_growing([cloud], [nothing], [np.full(len(truth), -1)], 4)
    with pytest.raises(ValueError, match='1 clouds, 1 descriptors, 2 annotated labels'):
        tune_region_growing([cloud], [nothing], [truth, truth], 4)
    with pytest.raises(ValueError, match='0 clouds'):
        tune_region_growing([], [], [], 4)
    with pytest.raises(ValueError, match='has 2400 descriptors and 3 annotated labels'):
        tune_region_growing([cloud], [nothing], [truth[:3]], 4)
