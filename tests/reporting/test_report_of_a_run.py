"""The page that a run leaves."""

import math
import re

from rm3d_plugin.engine.hooks.run_record_hook import final_records, score_records
from rm3d_plugin.reporting.scores import loss_charts, result_rows


def test_curves_go_by_epoch_number_not_by_its_text():
    losses = {str(epoch): {'loss': float(epoch), 'loss_vote': 0.0, 'lr': 1.0} for epoch in (10, 9, 2, 1)}
    losses = {epoch: values | {'loss_box': 2.0} for epoch, values in losses.items()}
    charts = loss_charts(losses)
    assert [list(chart.series) for chart in charts] == [['loss'], ['loss_vote'], ['loss_box']]
    assert all(chart.small for chart in charts)
    line = charts[0].series['loss']
    assert list(line.x) == [1, 2, 9, 10] and list(line.y) == [1, 2, 9, 10]
    assert loss_charts({}) == []
    one = {'1': {'loss': 1.0, 'loss_wsl': 1.0}}
    assert len(loss_charts(one)) == 1, 'a sum of one part is said once'


def test_a_run_leaves_one_page_without_links_that_tells_its_numbers(finished):
    page = (finished.folder / 'report.html').read_text()
    assert not re.search(r'(src|href)\s*=\s*["\']?(https?:|//)', page) and '@import' not in page and 'url(' not in page
    assert '<script' not in page or 'src=' not in page.split('<script', 1)[1].split('>', 1)[0]
    assert 'id="view-data"' in page and 'all boxes' in page and re.search(r'\d+ of \d+ boxes, [\d.]+ %', page)
    assert 'ynthetic' in page and 'rm3d_votenet_kitti_1pct' in page
    final = final_records(finished.record)
    assert {r.name: r.value for r in final if r.value is not None} == finished.record['final']
    assert list(score_records(finished.record)) == [1, 2]
    assert page.count('data:image/png;base64,') >= 2
    for name, metric, *numbers in result_rows(final):
        assert name in page and metric.split(' @ ')[0].split()[0] in page
        for number in numbers:
            assert math.isnan(number) or f'{number:.1f}' in page, (name, metric, number)
    budget = re.search(r'Label budget (\w+), seed 0: 1 of (\d+) boxes', finished.log)
    assert budget[1] in page
