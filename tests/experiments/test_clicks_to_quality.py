"""The made-up annotator, the scores by which it clicks, and the table of its curves."""

from dataclasses import replace

import numpy as np
import pytest
from reference.corner_scan import corner
from scipy.spatial import cKDTree

from rm3d_plugin.baselines.redal import surface_interest
from rm3d_plugin.baselines.redal.score import CLIPPED, GRADIENT, NEIGHBORS, VARIATION
from rm3d_plugin.experiments.benchmarks.propagate_clicks import Scan
from rm3d_plugin.experiments.click_curves import BOUND, NEAREST, OURS, Curve, clicks_to, curves_of
from rm3d_plugin.experiments.next_click import SCORES, ClickChooser
from rm3d_plugin.experiments.render import to_csv, to_markdown
from rm3d_plugin.experiments.spec import Request, Scale
from rm3d_plugin.experiments.tables import clicks_to_quality as table
from rm3d_plugin.pseudo_labels.propagation import prepare_cloud
from rm3d_plugin.pseudo_labels.propagation.live import LivePropagation
from rm3d_plugin.structures import PointCloud

CLICKS = 5


@pytest.fixture(scope='module')
def scan():
    """A corner in colours, of whose points every seventh has no class."""
    xyz, semantic = corner()
    semantic = semantic.copy()
    semantic[::7] = -1
    colors = np.random.default_rng(0).uniform(0, 1, xyz.shape)
    return Scan('corner', PointCloud(xyz.astype(np.float32), colors=colors), semantic)


@pytest.fixture(scope='module')
def curves(scan):
    return list(curves_of(scan, SCORES, [0, 1], CLICKS))


def test_the_annotator_clicks_as_told_and_is_scored_on_known_points(scan, curves):
    found = {(curve.score, curve.labels, curve.seed): curve.right for curve in curves}
    assert len(found) == (len(SCORES) * 2 + 1) * 2 and {len(right) for right in found.values()} == {CLICKS}
    most = found[*BOUND, 0]
    assert most[1:] == [100.0] * (CLICKS - 1)  # two classes
    assert all(right[0] <= most[0] + 1e-9 for right in found.values())
    ours = found['ours', OURS, 0]
    assert ours[1] > 85 > 70 > ours[0]  # the second click is on the other class
    assert np.mean(ours) > np.mean(found['ours', NEAREST, 0])
    clicked = np.random.default_rng(1).choice(np.flatnonzero(scan.semantic >= 0))  # the first by chance, seed 1
    right = (scan.semantic == scan.semantic[clicked]).sum() / (scan.semantic >= 0).sum()
    assert all(found[name, NEAREST, 1][0] == pytest.approx(100 * right) for name in SCORES)


def test_uncertain_regions_are_clicked(scan):
    live = LivePropagation(prepare_cloud(scan.cloud))
    chooser, scale = ClickChooser(live, scan.semantic), live.scene.scales[-1]
    clicked = np.array([np.flatnonzero(scan.semantic == 0)[5], np.flatnonzero(scan.semantic == 1)[5]])
    answer = live.answer(clicked, scan.semantic[clicked], 2)
    entropy = -(answer.shares * np.log2(np.maximum(answer.shares, 1e-9))).sum(axis=1)
    said = answer.shares.argmax(axis=1)
    expected = {'entropy': [], 'mixture': [], 'redal': []}
    interest = surface_interest(scan.cloud)
    for region in range(len(scale.sizes)):
        inside = scale.region == region
        for name, shares in (
            ('entropy', answer.shares[inside].mean(axis=0)),
            ('mixture', np.bincount(said[inside], minlength=2) / inside.sum()),
        ):
            expected[name].append(-(shares * np.log2(np.maximum(shares, 1e-9))).sum())
        expected['redal'].append((entropy / 2 + interest)[inside].mean())  # the mean over two classes
    for name in ('entropy', 'mixture'):
        np.testing.assert_allclose(chooser._scored(name, answer, clicked), expected[name], atol=1e-4)
        point = chooser.by(name, 0)(answer, clicked, set())
        assert expected[name][scale.region[point]] == pytest.approx(max(expected[name]), abs=1e-4)
    share = chooser._scored('redal', answer, clicked) / expected['redal']
    decayed = np.bincount(chooser._cluster[scale.region[clicked]], minlength=20)[chooser._cluster]
    np.testing.assert_allclose(share, 0.95**decayed, atol=1e-3)


def test_interest_is_gradient_and_variation_of_fifty_neighbours(scan):
    near = cKDTree(scan.cloud.xyz).query(scan.cloud.xyz[:20], NEIGHBORS)[1]
    found = surface_interest(scan.cloud)
    for point, others in enumerate(near):
        lengths = np.linalg.eigvalsh(np.cov(scan.cloud.xyz[others].astype(np.float64).T))
        gradient = np.abs(scan.cloud.colors[others] - scan.cloud.colors[point]).mean()
        expected = VARIATION * min(lengths[0] / lengths.sum(), CLIPPED) + GRADIENT * min(gradient, CLIPPED)
        assert found[point] == pytest.approx(expected, abs=2e-3)  # a tie may be another neighbour


def test_the_table_has_medians_of_seeds_and_means_of_scans():
    rights = [[50.0, 75, 85, 95, 95], [60, 65, 85, 91, 70], [10, 20, 30, 40, 50]]
    curves = [Curve('a', 'ours', OURS, seed, right) for seed, right in enumerate(rights)]
    curves += [Curve('b', 'ours', OURS, seed, [71.0, 81, 91, 91, 91]) for seed in range(3)]
    np.testing.assert_array_equal(clicks_to(70, np.array(rights)), [2, 3, 6])
    filled = table.fill_clicks({'oakland': curves}, [0, 1, 2])
    assert [section.title for section in filled.sections] == ['Oakland, real (2)', 'Real scans together (2)']
    row = filled.sections[0].rows[0]
    assert row.name == 'ours, ours'
    assert [cell.text for cell in row.cells] == ['81.3', '2.0', '2.5', '3.5']  # after 5; to 70, 80, 90 %
    assert '| ours, ours | 81.3 | 2.0 | 2.5 | 3.5 |' in to_markdown(filled)
    assert to_csv(filled).splitlines()[1] == 'oakland,a,ours,ours,0,50.0,75,85,95,95'
    assert filled.figure().startswith(b'\x89PNG')


def test_scans_that_were_measured_are_kept(scan, tmp_path, monkeypatch):
    monkeypatch.setattr(table, 'scans_of_group', lambda group, request: iter([scan]))
    request = Request(tmp_path, seeds=(0,), data=('rooms',), log=lambda text: None)
    first = table.clicks_table(request, scores=('chance',), clicks=3)
    monkeypatch.setattr(table, 'curves_of', None)  # nothing is measured again
    assert table.clicks_table(request, scores=('chance',), clicks=3).records == first.records


def test_a_smaller_request_takes_fewer_real_scans(tmp_path, monkeypatch):
    monkeypatch.setattr(table, 'oakland', lambda root: iter('abc'))
    request = Request(tmp_path, scenes=2)
    assert list(table.scans_of_group('oakland', request)) == ['a', 'b', 'c']
    assert list(table.scans_of_group('oakland', replace(request, scale=Scale(0.5)))) == ['a', 'b']
