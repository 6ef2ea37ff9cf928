"""Records of metrics to tables, text and curves."""

import math

import numpy as np
import pytest

from rm3d_plugin.evaluation.functional.kitti_ap import ApEntry, KittiAp
from rm3d_plugin.evaluation.kitti_table import kitti_records
from rm3d_plugin.evaluation.records import ScoreRecord, share
from rm3d_plugin.evaluation.sem_seg_metric import AGREEMENT as AGREES
from rm3d_plugin.reporting.scores import (
    final_text,
    headlines,
    label_charts,
    point_table,
    result_rows,
    result_table,
    score_chart,
)

SCORES = (
    share('IoU_wall', 0.615, 'points', 'IoU', subject='wall'),
    share('IoU_other furniture', math.nan, 'points', 'IoU', subject='other furniture'),
    share('mIoU', 0.4025, 'points', 'IoU', headline='mIoU'),
    share('mAcc', 0.5, 'points', 'mean recall of the classes'),
    share('accuracy', 0.7, 'points', 'correct points'),
    *(share(f'{m}_chair', v, 'instances', m, subject='chair') for m, v in (('AP', 0.125), ('AP50', 0.25))),
    share('AP', 0.01, 'instances', 'AP'),
    share('AP50', 0.02, 'instances', 'AP50', headline='AP50 of instances'),
    share('coverage', 0.9, 'pseudo labels', 'coverage'),
)


def plain(table):
    return [tuple(None if isinstance(v, float) and math.isnan(v) else v for v in row) for row in table.rows]


def test_scores_of_a_class_stand_in_one_row():
    table = point_table(SCORES)
    assert table.head == ('Class', 'IoU', 'AP', 'AP50')
    assert plain(table) == [
        ('wall', 61.5, None, None),
        ('other furniture', None, None, None),
        ('chair', None, 12.5, 25.0),
        ('mean', 40.25, 1.0, 2.0),
        ('mean recall of the classes', 50.0, None, None),
        ('correct points', 70.0, None, None),
    ]


def test_a_class_may_be_called_anything():
    records = [
        share('precision_mIoU_3d_moderate', 0.01, 'instances', 'precision', subject='mIoU_3d_moderate'),
        share('recall_mIoU_3d_moderate', 0.02, 'instances', 'recall', subject='mIoU_3d_moderate'),
        share('mPrec', 0.03, 'instances', 'precision'),
        share('mRec', 0.04, 'instances', 'recall'),
        share('mCov', 0.05, 'instances', 'mean coverage of instances'),
    ]
    table = point_table(records)
    assert table.head == ('Class', 'precision', 'recall')
    assert plain(table) == [
        ('mIoU_3d_moderate', 1.0, 2.0),
        ('mean', 3.0, 4.0),
        ('mean coverage of instances', 5.0, None),
    ]


def test_other_scores_make_no_table():
    assert point_table(()) is None and point_table(SCORES[-1:]) is None and point_table(boxes()) is None


def test_the_table_as_text_has_the_same_numbers():
    lines = [line.rsplit(maxsplit=3) for line in result_table(SCORES).splitlines()]
    assert lines[0] == ['class', 'IoU', 'AP', 'AP50']
    assert ['wall', '61.50', '-', '-'] in lines and ['mean', '40.25', '1.00', '2.00'] in lines


def boxes(loose=False):
    """Two classes, one of them without truth in the easy frames."""
    entries = [
        ApEntry(name, metric, level, 0.5, r40, 0.0, truths, np.zeros(41))
        for metric, low in (('bbox', 0.0), ('3d', 10.0))
        for name, level, r40, truths in (
            ('Car', 'easy', 12.345 + low, 3), ('Car', 'moderate', 7.0 + low, 3), ('Car', 'hard', 0.0, 3),
            ('Person_sitting', 'easy', math.nan, 0), ('Person_sitting', 'hard', 4.0, 1),
        )
    ]  # fmt: skip
    return kitti_records(KittiAp(tuple(entries)), 'loose' if loose else '')


def test_boxes_become_rows_of_three_difficulties():
    found = {tuple(row[:2]): row[2:] for row in result_rows([*boxes(), *boxes(loose=True)])}
    assert found['Car', '3d AP R40 @ 0.50'] == (22.345, 17, 0)
    np.testing.assert_array_equal(found['Person_sitting', '3d AP R40 @ 0.50'], [np.nan, np.nan, 4])
    assert found['mean', '3d AP R40'] == (22.345, 17, 2) == found['mean', '3d AP R40 loose']
    assert len(found) == 4 and result_rows(SCORES) == []
    named = {record.key: record.value for record in [*boxes(), *boxes(loose=True)]}
    assert named['Person_sitting_3d_hard_R40@0.50'] == 4.0 and named['mAP_3d_moderate_R40_loose'] == 17.0
    assert 'Person_sitting_3d_easy_R40@0.50' not in named


def test_boxes_as_text():
    lines = [line.split() for line in result_table(boxes()).splitlines()]
    assert lines[0] == ['class', 'AP', 'easy', 'moderate', 'hard']
    assert ['Car', '3d', 'AP', 'R40', '@', '0.50', '22.34', '17.00', '0.00'] in lines
    assert ['Person_sitting', '3d', 'AP', 'R40', '@', '0.50', '-', '-', '4.00'] in lines


def test_headlines():
    assert headlines(SCORES) == {'mIoU': '40.2 %', 'AP50 of instances': '2.0 %'}
    assert headlines([*boxes(), *boxes(True)]) == {'3D AP, official IoU': '17.0 %', '3D AP, loose IoU': '17.0 %'}
    assert headlines([ScoreRecord('mIoU', None, 'points', 'IoU', headline='mIoU')]) == {}


def test_curves_of_validations():
    def validation(value):
        return [ScoreRecord('mIoU', value, 'points', 'IoU', prefix='val'), SCORES[0]]

    chart = score_chart({2: validation(None), 10: validation(3.0)})
    assert list(chart.series) == ['val/mIoU'] and list(chart.series['val/mIoU'].x) == [2, 10]
    assert math.isnan(chart.series['val/mIoU'].y[0]) and chart.series['val/mIoU'].y[1] == 3.0
    assert score_chart({1: validation(1.0)}) is None and score_chart({1: (), 2: ()}) is None
    assert list(score_chart({1: boxes(), 2: boxes()}).series) == ['Car_3d_moderate_R40@0.50', 'mAP_3d_moderate_R40']


@pytest.mark.parametrize('known', [True, False])
def test_curves_of_labels(known):
    rounds = [
        {'round': n, 'coverage': c, 'precision': p, 'mean_precision': m, 'offset_error': o if known else None}
        for n, c, p, m, o in ((0, 0.25, 0.5, 0.25, 0.5), (1, 0.75, 1.0, 0.5, 0.25))
    ]
    labels, *offsets = label_charts(rounds)
    assert list(labels.series['coverage'].y) == [25.0, 75.0] and list(labels.series['precision'].y) == [50.0, 100.0]
    assert list(labels.series['mean precision of the classes'].y) == [25.0, 50.0]
    assert len(offsets) == known
    if known:
        assert list(offsets[0].series['all classes'].y) == [0.5, 0.25] and list(offsets[0].series['all classes'].x) == [
            0,
            1,
        ]
    unknown = {'coverage': 1.0, 'mean_precision': None}
    assert label_charts(rounds[:1]) == [] and label_charts([{'round': 0, **unknown}] * 2) == []


ESTIMATE = {'estimate': {'miou': 68.2, 'low': 60.9, 'high': 75.0, 'clicks': 240}}
AGREEMENT = (share('agreement_not_accuracy', 0.477, 'agreement', AGREES),)


@pytest.mark.parametrize(
    ('labels', 'told'),
    [
        (ESTIMATE, 'about 68 (61 to 75) mIoU, from 240 of your clicks'),
        ({'estimate': None}, 'no estimate: too few clicks'),
        ({}, 'no estimate: the labels were not checked by left-out clicks'),
    ],
)
def test_agreement_is_told_as_such_and_the_estimate_stands_first(labels, told):
    assert final_text(AGREEMENT, labels).splitlines() == [
        f'pseudo labels: {told}',
        'network: 47.7 % agreement with its own pseudo labels, not accuracy',
    ]
    assert point_table(AGREEMENT) is None and headlines(AGREEMENT) == {}
    assert score_chart({1: AGREEMENT, 2: AGREEMENT}) is None


def test_scores_stay_and_the_estimate_follows_them():
    assert final_text(SCORES, {}) == result_table(SCORES)
    assert final_text(SCORES, ESTIMATE).splitlines()[-1].startswith('pseudo labels: about 68 (61 to 75) mIoU')
