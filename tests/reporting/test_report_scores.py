"""Flat scores of segmentation to tables, text and curves."""

import math

from rm3d_plugin.reporting.scores import headlines, label_charts, point_table, result_table, score_chart

SCORES = {
    'IoU_wall': 61.5,
    'IoU_other furniture': None,
    'mIoU': 40.25,
    'mAcc': 50.0,
    'accuracy': 70.0,
    'AP_chair': 12.5,
    'AP50_chair': 25.0,
    'AP25_chair': 37.5,
    'AP': 1.0,
    'AP50': 2.0,
    'AP25': 3.0,
}


def plain(table):
    return [tuple(None if isinstance(v, float) and math.isnan(v) else v for v in row) for row in table.rows]


def test_scores_of_a_class_stand_in_one_row():
    table = point_table(SCORES)
    assert table.head == ('Class', 'IoU', 'AP', 'AP50', 'AP25')
    assert plain(table) == [
        ('wall', 61.5, None, None, None),
        ('other furniture', None, None, None, None),
        ('chair', None, 12.5, 25.0, 37.5),
        ('mean', 40.25, 1.0, 2.0, 3.0),
        ('mean recall of the classes', 50.0, None, None, None),
        ('points that are right', 70.0, None, None, None),
    ]


def test_precision_and_recall_of_instances_and_prefixes():
    table = point_table(
        {'val/precision_a_b': 1.0, 'val/recall_a_b': 2.0, 'val/mPrec': 3.0, 'val/mRec': 4, 'val/mCov': 5}
    )
    assert table.head == ('Class', 'precision', 'recall')
    assert plain(table) == [('a_b', 1.0, 2.0), ('mean', 3.0, 4.0), ('mean coverage of instances', 5.0, None)]


def test_other_scores_make_no_table():
    assert point_table({}) is None and point_table({'Car_3d_easy_R40@0.70': 1.0, 'loss': 2.0, 'mAP_3d': 1.0}) is None


def test_the_table_as_text_has_the_same_numbers():
    lines = [line.rsplit(maxsplit=4) for line in result_table(SCORES).splitlines()]
    assert lines[0] == ['class', 'IoU', 'AP', 'AP50', 'AP25']
    assert ['wall', '61.50', '-', '-', '-'] in lines and ['mean', '40.25', '1.00', '2.00', '3.00'] in lines


def test_headlines():
    assert headlines(SCORES) == {'mIoU': '40.2 %', 'AP50 of instances': '2.0 %'}
    assert headlines({'mIoU': None}) == {} and headlines({'val/mIoU': 1.0}) == {'mIoU': '1.0 %'}


def test_curves_of_validations():
    chart = score_chart({'10': {'mIoU': 3.0, 'IoU_wall': 1.0}, '2': {'mIoU': None}})
    assert list(chart.series) == ['mIoU'] and list(chart.series['mIoU'].x) == [2, 10]
    assert math.isnan(chart.series['mIoU'].y[0]) and chart.series['mIoU'].y[1] == 3.0
    assert score_chart({'1': {'mIoU': 1.0}}) is None and score_chart({'1': {}, '2': {}}) is None


def test_curves_of_labels():
    rounds = [
        {'round': n, 'coverage': c, 'precision': p, 'mean_precision': m, 'offset_error': o}
        for n, c, p, m, o in ((0, 0.25, 0.5, None, 0.5), (1, 0.75, 1.0, 0.5, 0.25))
    ]
    labels, offsets = label_charts(rounds)
    assert list(labels.series['coverage'].y) == [25.0, 75.0] and list(labels.series['precision'].y) == [50.0, 100.0]
    assert math.isnan(labels.series['mean precision of the classes'].y[0])
    assert list(offsets.series['all classes'].y) == [0.5, 0.25] and list(offsets.series['all classes'].x) == [0, 1]
    assert len(label_charts([{**entry, 'offset_error': None} for entry in rounds])) == 1
    assert label_charts(rounds[:1]) == [] and label_charts([{'round': 0, 'coverage': 1.0}] * 2) == []
