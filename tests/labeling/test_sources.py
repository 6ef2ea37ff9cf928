"""What a label budget shows of a data set, and what a resumed run takes up."""

from types import SimpleNamespace

import numpy as np
import pytest

from rm3d_plugin.datasets import Truth
from rm3d_plugin.label_budgets import BudgetError
from rm3d_plugin.labeling import BoxBudgetSource
from rm3d_plugin.structures import Boxes3D, PointCloud

BOXES = np.array([[0, 0, 0, 2, 2, 2, 0], [10, 0, 0, 2, 2, 2, 0], [20, 0, 0, 2, 2, 2, 0]], dtype=float)
CLOUD = PointCloud(xyz=np.repeat(BOXES[:, :3], 6, axis=0)[:17])  # six points in each box, five in the last
CLOUD_LABELS = np.repeat([0, 1, 0], 6)[:17]


def source(budget='full', seed=0, scenes=4, **settings):
    """Each scene has a car, a walker, a car."""
    dataset = SimpleNamespace(
        metainfo={'classes': ('Car', 'Pedestrian')},
        scene_ids=[f's{i}' for i in range(scenes)],
        is_labelled=lambda index: True,
        load_cloud=lambda index: CLOUD,
        load_truth=lambda index: Truth(Boxes3D(BOXES, np.array([0, 1, 0])), CLOUD_LABELS, None),
    )
    return BoxBudgetSource(dataset, budget, seed, **settings)


def test_everything_annotated_is_complete():
    annotated = source('full').annotated_labels(2)
    assert annotated.complete and len(annotated.boxes) == 3
    np.testing.assert_array_equal(annotated.semantic, CLOUD_LABELS)
    np.testing.assert_array_equal(annotated.instance, np.repeat([0, 1, 2], 6)[:17])


def test_a_few_boxes_reveal_themselves_and_their_points_only():
    some = source({'per_scene': 0.5})
    drawn = [(index, row) for index in range(4) for row in some.budget.annotated[f's{index}']]
    assert len(drawn) == 2
    for index in range(4):
        annotated = some.annotated_labels(index)
        rows = [row for scene, row in drawn if scene == index]
        assert not annotated.complete
        np.testing.assert_array_equal(annotated.boxes.tensor, BOXES[rows])
        inside = np.isin(np.repeat([0, 1, 2], 6)[:17], rows)
        np.testing.assert_array_equal(annotated.semantic, np.where(inside, CLOUD_LABELS, -1))
    assert 'Car' in some.describe() and '2 of 12 boxes' in some.describe()


def test_boxes_with_too_few_points_are_never_drawn():
    drawn = source({'fraction': 0.9}, min_points=6).budget.annotated
    assert all(2 not in rows for rows in drawn.values()) and sum(map(len, drawn.values())) == 8
    assert sum(map(len, source({'fraction': 0.9}, min_points=5).budget.annotated.values())) == 11


def test_the_seed_chooses_and_the_draw_is_kept_for_resuming(tmp_path):
    first, other = source('1pct', scenes=30), source('1pct', seed=1, scenes=30)
    assert first.budget.annotated == source('1pct', scenes=30).budget.annotated != other.budget.annotated
    first.open(tmp_path, resume=False)
    again = source('1pct', scenes=30)
    again.open(tmp_path, resume=True)
    assert again.budget == first.budget


@pytest.mark.parametrize(('budget', 'seed'), [('full', 0), ('1pct', 1), ({'per_scene': 0.3}, 0)])
def test_a_run_is_not_resumed_with_another_budget(tmp_path, budget, seed):
    source('1pct').open(tmp_path, resume=False)
    with pytest.raises(BudgetError, match=rf'budget\.json: was drawn with seed 0.* but seed {seed} .*another work dir'):
        source(budget, seed).open(tmp_path, resume=True)
    source({'per_scene': 0.2}).open(tmp_path, resume=True)  # the same amount under another name


def test_nothing_to_resume_is_told(tmp_path):
    with pytest.raises(BudgetError, match=r'budget\.json: no such label budget'):
        source().open(tmp_path, resume=True)


def test_of_scenes_that_nobody_labelled_nothing_is_drawn_shown_or_judged():
    some = source('full', scenes=3)
    some.dataset.is_labelled = lambda index: index != 1
    assert [len(some.annotated_labels(index).boxes) for index in range(3)] == [3, 0, 3]
    assert [some.annotated_labels(index).complete for index in range(3)] == [True, False, True]
    assert some.truth(1) is None and some.truth(2) is not None
