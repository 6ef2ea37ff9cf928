"""PointContrast, CSC and Viewpoint Bottleneck against loops over their formulas."""

import math

import numpy as np
import pytest
import torch

from rm3d_plugin.baselines.csc.loss import SceneContexts, space_groups
from rm3d_plugin.baselines.pointcontrast.loss import PointContrast
from rm3d_plugin.baselines.viewpoint_bottleneck.loss import ViewpointBottleneck, bottleneck_loss
from rm3d_plugin.models import Batch, View
from rm3d_plugin.models.pretraining import Encoded, match_views

SIZES = (6, 5)


def made(seed=0, shared=True):
    """Two scenes, and a view of some of their points in another order; one of its points is new."""
    rng = torch.Generator().manual_seed(seed)
    xyz = 4 * torch.rand(sum(SIZES), 3, generator=rng)
    ids = torch.tensor([3, 0, -1, 5, 10, 7, 8]) if shared else torch.full((7,), -1)
    second = torch.randn(7, 4, generator=rng)
    view = View(torch.zeros(7, 3), torch.tensor([0, 4, 7]), ids, lambda points, offsets: second, lambda rows: rows)
    batch = Batch(xyz, torch.tensor([0, 6, 11]), (view,))
    return batch, Encoded(torch.randn(sum(SIZES), 4, generator=rng, requires_grad=True))


def pairs_of(batch, outputs):
    """(scene, place, first feature, second feature) of the common points."""
    view, found = batch.views[0], []
    for row, point in enumerate(view.point_ids.tolist()):
        if point >= 0:
            found.append((int(point >= 6), batch.xyz[point], outputs.features[point].detach(), view.features[row]))
    return found


def cosine(one, other):
    return float(torch.nn.functional.cosine_similarity(one, other, dim=0))


def project_of(term):
    return lambda row: term.project(row).detach()


def test_matches_know_their_scene_and_place():
    batch, outputs = made()
    found = match_views(outputs.features, batch.xyz, batch.batch_offsets, batch.views[0], 99)
    assert sorted(found.scene.tolist()) == [0, 0, 0, 1, 1, 1] and len(found.of_scene(1).xyz) == 3
    away = found.distances()
    assert torch.isinf(away[found.scene[:, None] != found.scene]).all() and away.diagonal().abs().max() < 1e-3
    assert len(match_views(outputs.features, batch.xyz, batch.batch_offsets, batch.views[0], 2).xyz) == 2


def test_point_contrast_over_the_whole_batch():
    batch, outputs = made()
    term = PointContrast(4, voxel_size=1.0)
    project, pairs = project_of(term), pairs_of(batch, outputs)
    losses = []
    for i, (scene, place, first, second) in enumerate(pairs):
        total = alike = math.exp(cosine(project(first), project(second)) / 0.4)
        for j, (other_scene, other_place, _, other) in enumerate(pairs):
            near = other_scene == scene and torch.dist(place, other_place) < 1.5
            if i != j and not near:
                total += math.exp(cosine(project(first), project(other)) / 0.4)
        losses.append(-math.log(alike / total))
    value = term(batch, outputs, None)['loss_contrast']
    assert value.item() == pytest.approx(np.mean(losses), rel=1e-4)
    value.backward()
    assert outputs.features.grad.abs().sum() > 0


def test_hardest_negatives_in_both_directions():
    batch, outputs = made()
    term = PointContrast(4, voxel_size=0.001, kind='hardest')
    unit = lambda row: torch.nn.functional.normalize(term.project(row).detach(), dim=0)  # noqa: E731
    pairs = [(unit(first), unit(second)) for _, _, first, second in pairs_of(batch, outputs)]
    losses = []
    for i, pair in enumerate(pairs):
        alike = max(float((pair[0] - pair[1]).square().sum()) - 0.1, 0)
        for here, there in ((0, 1), (1, 0)):
            far = min(float(torch.dist(pair[here], other[there])) for j, other in enumerate(pairs) if j != i)
            losses.append(alike + max(1.4 - far, 0) ** 2)
    assert term(batch, outputs, None)['loss_contrast'].item() == pytest.approx(np.mean(losses), rel=1e-4)


def test_groups_of_space_by_hand():
    xyz = torch.tensor([[0.0, 0, 0], [0, 0, 3], [3, 0, 0], [0, 0, 30], [1, 0, 0]])
    from_first = space_groups(xyz, 2.0, 20.0)[:, 0]
    assert [row.nonzero()[:, 0].tolist() for row in from_first] == [[1], [2], [3], []]


def test_scene_contexts():
    batch, outputs = made()
    term = SceneContexts(4, inner=0.8, outer=2.5)
    project, scenes = project_of(term), []
    for scene in (0, 1):
        pairs = [pair for pair in pairs_of(batch, outputs) if pair[0] == scene]
        parts = []
        for part in range(4):
            for _, place, first, second in pairs:
                total = alike = math.exp(cosine(project(first), project(second)) / 0.4)
                for _, other_place, _, other in pairs:
                    away, above = torch.dist(place, other_place), bool(other_place[2] > place[2])
                    group = None if away <= 0.8 else 2 * int(away > 2.5) + (not above)
                    if group == part:
                        total += math.exp(cosine(project(first), project(other)) / 0.4)
                parts.append(-math.log(alike / total))
        scenes.append(np.mean(parts))
    assert term(batch, outputs, None)['loss_contexts'].item() == pytest.approx(np.mean(scenes), rel=1e-4)


@pytest.mark.parametrize(('version', 'aim', 'factor'), [('paper', 1, 1), ('code', 2, 1 / 512)])
def test_bottleneck_by_numpy(version, aim, factor):
    first, second = np.random.default_rng(0).normal(size=(2, 20, 3))
    correlation = sum(np.outer(a, b) for a, b in zip(zscore(first), zscore(second), strict=True)) / 20
    expected = 0.0
    for d in range(3):
        for e in range(3):
            expected += (aim - correlation[d, d]) ** 2 if d == e else 3.9e-3 * correlation[d, e] ** 2
    got = bottleneck_loss(torch.tensor(first), torch.tensor(second), version=version)
    assert got.item() == pytest.approx(factor * expected, rel=1e-4)


def zscore(values):
    return (values - values.mean(0)) / values.std(0)


def test_equal_independent_channels_have_no_bottleneck_loss():
    values = torch.tensor([[1.0, 1], [1, -1], [-1, 1], [-1, -1]])
    assert bottleneck_loss(values, 3 * values + 7).item() == pytest.approx(0, abs=1e-5)


def test_viewpoint_bottleneck_is_the_mean_over_scenes():
    batch, outputs = made()
    term = ViewpointBottleneck(4, channels=3)
    scenes = []
    for scene in (0, 1):
        pairs = [pair for pair in pairs_of(batch, outputs) if pair[0] == scene]
        stacked = (torch.stack([term.project(pair[part]) for pair in pairs]) for part in (2, 3))
        scenes.append(bottleneck_loss(*stacked).item())
    assert term(batch, outputs, None)['loss_bottleneck'].item() == pytest.approx(np.mean(scenes), rel=1e-4)


@pytest.mark.parametrize('term', [PointContrast(4, 0.1), SceneContexts(4), ViewpointBottleneck(4)])
def test_views_without_a_common_point_teach_nothing(term):
    batch, outputs = made(shared=False)
    ((_, value),) = term(batch, outputs, None).items()
    value.backward()
    assert value.item() == 0 and outputs.features.grad.abs().sum() == 0
