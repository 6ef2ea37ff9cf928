"""Pictures of our own runs, on made-up stores and a small room; nothing is trained."""

import math
from pathlib import Path

import numpy as np
import pytest

from rm3d_plugin.experiments.render import to_format, to_markdown
from rm3d_plugin.experiments.scenes import Collection, TableScene, described_surface
from rm3d_plugin.experiments.tables import figures
from rm3d_plugin.experiments.tables.figures import Quality, draw_merging, fill_quality, merge_scene, purity, qualities
from rm3d_plugin.storage import LabelStore
from rm3d_plugin.structures import PointCloud


@pytest.fixture(scope='module')
def corner() -> Collection:
    """A floor and a wall, each of its own class, with one labelled point each."""
    rng = np.random.default_rng(0)
    floor = np.column_stack([rng.uniform(0, 2, (600, 2)), np.zeros(600)])
    wall = np.column_stack([np.zeros(600), rng.uniform(0, 2, (600, 2))])
    xyz = np.concatenate([floor, wall]).astype(np.float32) + rng.normal(0, 0.002, (1200, 3)).astype(np.float32)
    label = np.repeat([0, 1], 600)
    scene = TableScene('corner', described_surface(PointCloud(xyz)), label, label)
    return Collection('corner', 'corner (synthetic)', 'indoor', 2, (), (scene,))


def test_merging_joins_regions_of_one_class(corner, monkeypatch):
    monkeypatch.setattr(figures, 'SHOWN', ('AdaptedPFH',))
    merged = merge_scene(corner, corner.scenes[0], 'AdaptedPFH', 0)
    assert 1 < merged.groups.max() + 1 <= merged.regions.max() + 1
    together = [np.unique(merged.groups[merged.regions == region]) for region in np.unique(merged.regions)]
    assert all(len(groups) == 1 for groups in together)  # it only coarsens
    assert purity(merged.groups, corner.scenes[0].semantic) > 90
    assert draw_merging(corner, 0)[:4] == b'\x89PNG'


def test_purity_by_hand():
    assert purity(np.array([0, 0, 1, 1]), np.array([0, 1, 1, -1])) == pytest.approx(200 / 3)
    assert math.isnan(purity(np.array([-1]), np.array([0])))


def test_quality_of_labels_by_round(tmp_path: Path, monkeypatch):
    told = {
        0: {'coverage': 0.5, 'precision': 0.9, 'offset_error': 0.25},
        1: {'coverage': 0.75, 'precision': None, 'offset_error': None},
    }
    monkeypatch.setattr(LabelStore, 'rounds', lambda self: tuple(told))
    monkeypatch.setattr(LabelStore, 'summary', lambda self, number: told[number])
    found = qualities('RM3D', tmp_path)
    assert found[0] == Quality('RM3D', 0, 50.0, 90.0, 0.25) and math.isnan(found[1].precision)
    table = fill_quality(found)
    assert to_markdown(table).splitlines()[-2:] == ['| 0 | 50.0 | 90.0 | 0.25 |', '| 1 | 75.0 | - | - |']
    assert to_format(table, 'png')[:4] == b'\x89PNG'
