"""Names of classes, scenes and files in a page are words: whatever they hold, the page has the same tags."""

from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from reference.toy_scenes import ToyRooms
from visualization.test_report import RUN

from rm3d_plugin.labeling import PointBudgetSource
from rm3d_plugin.reporting.draw_labels import draw_labels
from rm3d_plugin.visualization import (
    BudgetSummary,
    Chart,
    Layer,
    Picture,
    ResultRow,
    SceneView,
    Series,
    pack_views,
    render_report,
)
from rm3d_plugin.visualization.regions_page import write_regions_page
from rm3d_plugin.visualization.report_merges import MergeReport, MergeRow

EVIL = [
    '<script>alert(1)</script>', '</script><script>alert(1)</script>', '"><img src=x onerror=alert(1)>',
    "' onmouseover='alert(1)", '</title><svg onload=alert(1)>', '<!--', ']]>', '{{7*7}}${7*7}', 'javascript:alert(1)',
    '&lt;script&gt;', '\u202e\u0000x', '</style><style>*{display:none}',
]  # fmt: skip
PLAIN = 'wall'


class Tags(HTMLParser):
    """Start tags with the names of their attributes, and links."""

    def __init__(self, page):
        super().__init__()
        self.found, self.links = [], []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, [name for name, _ in attrs]))
        self.links += [value for name, value in attrs if name in ('href', 'src') and not value.startswith('data:')]
        assert not any(name.startswith('on') for name, _ in attrs), attrs


def same_tags(page, plain):
    found, expected = Tags(page), Tags(plain)
    assert found.found == expected.found and found.links == expected.links


def report_with(name):
    rounds = [
        {
            'coverage': 0.5, 'truth_known': True, 'points': {name: {'pseudo': 3, 'precision': 0.5}},
            'boxes': {name: {'annotated': 2, 'pseudo': 8, 'correct': 6, 'true': 26}},
        }
    ]  # fmt: skip
    row = MergeRow(name, (1, 2), (name, name), (3, 4), 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
    view = SceneView(name, np.eye(3), [Layer('prediction', 'class', np.array([0, 0, -1]), 'prediction')])
    return replace(
        RUN, title=name, notes=[name], summary={name: name}, budget=BudgetSummary(name, name, {name: (1, 2)}, 0),
        results=[ResultRow(name, name, 1.0, 2.0, 3.0)],
        charts=[Chart(name, name, name, {name: Series([1, 2], [3, 4])})],
        rounds=rounds, pictures=[Picture(name, b'x')], config={name: name}, config_text=name, seconds={name: 3.0},
        views=pack_views([view], (name,)), merges=MergeReport(0, 3, {name: 2}, {name: [row]}),
    )  # fmt: skip


@pytest.mark.parametrize('name', EVIL)
def test_a_report(name):
    page = render_report(report_with(name))
    same_tags(page, render_report(report_with(PLAIN)))


@pytest.mark.parametrize('name', EVIL)
def test_a_page_of_regions(tmp_path, name):
    pages = [
        write_regions_page(tmp_path / 'regions.html', np.eye(3), np.array([0, 1, -1]), title).read_text()
        for title in (name, PLAIN)
    ]
    same_tags(*pages)


class NamedRooms(ToyRooms):
    """Rooms and classes of any name."""

    name = PLAIN

    @property
    def metainfo(self):
        return {**super().metainfo, 'classes': (self.name, f'{self.name} 2', f'{self.name} 3')}


def test_a_page_of_labels(tmp_path, monkeypatch):
    """Pictures take names as they are, too: a formula of matplotlib's is none."""
    pages = []
    for name in ('<script>alert(1)</script>', PLAIN, '$\\nothing{$'):
        monkeypatch.setattr(NamedRooms, 'name', name)
        rooms = NamedRooms(count=1, labels='none', pipeline=[])
        source = PointBudgetSource(rooms, 'onept')
        draw_labels(source, tmp_path / 'labels.html', title=name)
        pages.append((tmp_path / 'labels.html').read_text())
    same_tags(*pages[:2])
    same_tags(*pages[1:])
