"""The report: scores to rows, and the page that a run leaves."""

import math
import re

from rm3d_plugin.reporting.run_report import loss_chart, result_rows, result_table, score_chart


def rows(scores):
    return [(row.class_name, row.metric, row.easy, row.moderate, row.hard) for row in result_rows(scores)]


def test_scores_become_rows_of_three_difficulties():
    scores = {
        'Car_3d_easy_R40@0.70': 1.0,
        'Car_3d_hard_R40@0.70': 3.0,
        'Car_3d_moderate_R40@0.70': 2.0,
        'Car_bev_moderate_R40@0.50': 4.0,
        'Person_sitting_3d_easy_R40@0.25': 5.0,
        'mAP_3d_moderate_R40': 6.0,
        'mAP_3d_moderate_R40_loose': 7.0,
    }
    found = {row[:2]: row[2:] for row in rows(scores)}
    assert found['Car', '3d AP R40 @ 0.70'] == (1, 2, 3)
    easy, moderate, hard = found['Car', 'bev AP R40 @ 0.50']
    assert moderate == 4 and math.isnan(easy) and math.isnan(hard)
    assert found['Person_sitting', '3d AP R40 @ 0.25'][0] == 5
    assert found['mean', '3d AP R40'][1] == 6 and found['mean', '3d AP R40 loose'][1] == 7
    assert len(found) == 5


def test_other_scores_are_no_rows():
    other = {'Car_bbox_easy_R40@0.70': 1.0, 'Car_3d_easy_R11@0.70': 1.0, 'loss': 2.0, 'time': 0.1, 'Car_3d_easy': 3.0}
    assert rows(other) == [] and rows({}) == []


def test_the_table_as_text_has_the_same_numbers():
    text = result_table({'Car_3d_easy_R40@0.70': 12.345, 'Car_3d_moderate_R40@0.70': 7.0, 'Car_3d_hard_R40@0.70': 0.0})
    assert text.splitlines()[1].split() == ['Car', '3d', 'AP', 'R40', '@', '0.70', '12.35', '7.00', '0.00'] or (
        text.splitlines()[1].split()[-3:] == ['12.34', '7.00', '0.00']
    )


def test_curves_go_by_epoch_number_not_by_its_text():
    losses = {str(epoch): {'loss': float(epoch), 'loss_vote': 0.0, 'lr': 1.0} for epoch in (10, 9, 2, 1)}
    chart = loss_chart(losses)
    assert list(chart.series) == ['loss', 'loss_vote']
    assert list(chart.series['loss'].x) == [1, 2, 9, 10] and list(chart.series['loss'].y) == [1, 2, 9, 10]
    assert loss_chart({}) is None and score_chart({'1': {'Car_3d_moderate_R40@0.70': 1.0}}) is None


def test_a_run_leaves_one_page_without_links_that_tells_its_numbers(finished):
    page = (finished.folder / 'report.html').read_text()
    assert not re.search(r'(src|href)\s*=\s*["\']?(https?:|//)', page) and '@import' not in page and 'url(' not in page
    assert '<script' not in page or 'src=' not in page.split('<script', 1)[1].split('>', 1)[0]
    assert 'ynthetic' in page and 'rm3d_votenet_kitti_1pct' in page
    final = finished.record['final']
    assert page.count('data:image/png;base64,') >= 2
    for name, metric, *numbers in rows(final):
        assert name in page and metric.split(' @ ')[0].split()[0] in page
        for number in numbers:
            assert math.isnan(number) or f'{number:.1f}' in page, (name, metric, number)
    budget = re.search(r'Label budget (\w+), seed 0: 1 of (\d+) boxes', finished.log)
    assert budget[1] in page
