from types import SimpleNamespace

import numpy as np
import pytest
import torch

from rm3d_plugin.baselines.cpcm.loss import MaskedConsistency
from rm3d_plugin.baselines.cpcm.masking import MaskedView, MaskSettings, hidden_points
from rm3d_plugin.models import Batch


def test_cells_are_bounded_by_quantiles_of_the_different_coordinates():
    xyz = np.zeros((80, 3))
    xyz[:, 0] = np.r_[np.zeros(73), 1, 2, 3, 100, 200, 300, 400]  # eight different values: four cells of two
    cells = [{0.0, 1.0}, {2.0, 3.0}, {100.0, 200.0}, {300.0, 400.0}]
    for seed in range(20):
        hidden = hidden_points(xyz, MaskSettings(), np.random.default_rng(seed))
        for cell in cells:
            assert len({bool(hidden[row]) for row in range(80) if xyz[row, 0] in cell}) == 1


@pytest.mark.parametrize(('share', 'wanted'), [(0.0, 0.0), (0.75, 0.75), (1.0, 1.0)])
def test_the_share_is_one_of_cells(share, wanted):
    grid = np.stack(np.meshgrid(*[np.arange(8.0)] * 3), axis=-1).reshape(-1, 3)
    hidden = hidden_points(grid, MaskSettings(cells=4, share=share), np.random.default_rng(0))
    assert hidden.mean() == wanted
    assert len(hidden_points(grid[:0], MaskSettings(), np.random.default_rng(0))) == 0


def test_hidden_points_lose_their_colour_and_nothing_else():
    points = np.random.default_rng(0).uniform(size=(200, 6)).astype(np.float32)
    found = MaskedView()({'points': points.copy(), 'rng': np.random.default_rng(3), 'views': ['first']})
    (first, view), hidden = found['views'], hidden_points(points[:, :3], MaskSettings(), np.random.default_rng(3))
    assert first == 'first' and np.array_equal(view.point_ids, np.arange(200)) and 0 < hidden.sum() < 200
    assert np.array_equal(view.points[:, :3], points[:, :3]) and np.array_equal(view.points[~hidden], points[~hidden])
    assert (view.points[hidden, 3:] == 0.5).all() and np.array_equal(found['points'], points)
    with pytest.raises(ValueError, match='cells >= 1'):
        MaskedView(cells=0)


def js(p, q):
    mean = (p + q) / 2
    raised = [np.log(v + 1e-4) for v in (p, q, mean)]
    return (p * (raised[0] - raised[2]) + q * (raised[1] - raised[2])).sum(axis=1)


def said(logits, point_ids, **more):
    return SimpleNamespace(logits=lambda rows=slice(None): logits[rows], point_ids=torch.tensor(point_ids), **more)


def test_the_masked_view_learns_from_both_others():
    generator = torch.Generator().manual_seed(0)
    first, plain, masked = (torch.randn(size, 4, generator=generator).requires_grad_() for size in (5, 3, 5))
    views = (said(plain, [4, -1, 0]), said(masked, [0, 1, 2, 3, 4]))
    batch = Batch(torch.zeros(5, 3), torch.tensor([0, 5]), views)
    got = MaskedConsistency(weight=2.0)(batch, SimpleNamespace(logits=first), None)['loss_masked']
    p, q, r = (values.detach().softmax(1).double().numpy() for values in (first, plain, masked))
    wanted = 2 * (js(r, p).mean() + js(r[[4, 0]], q[[0, 2]]).mean())
    assert got.item() == pytest.approx(wanted, rel=1e-4)
    got.backward()
    assert first.grad is None and plain.grad is None and masked.grad.abs().sum() > 0


def test_without_both_views_there_is_nothing_to_say():
    batch = Batch(torch.zeros(5, 3), torch.tensor([0, 5]), (said(torch.zeros(5, 2), range(5)),))
    assert MaskedConsistency()(batch, SimpleNamespace(logits=torch.zeros(5, 2)), None) == {}
