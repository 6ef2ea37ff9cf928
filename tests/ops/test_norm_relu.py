"""Batch normalisation with ReLU against torch's in float64."""

import pytest
import torch

from rm3d_plugin.ops.norm_relu import PART, norm_relu


@pytest.mark.parametrize('shape', [(2, 1), (7, 3), (1000, 16), (40, 1000), (PART // 16 + 3, 16)])
@pytest.mark.parametrize('dtype', [torch.float32, torch.float64])
def test_equals_torch(shape, dtype):
    torch.manual_seed(0)
    x = (torch.randn(shape, dtype=torch.float64) * 2 + 5).to(dtype)
    scale, shift = torch.rand(2, shape[1], dtype=dtype) + 0.5
    direction = torch.randn(shape, dtype=dtype)
    double = [v.double().requires_grad_() for v in (x, scale, shift)]
    wanted = torch.nn.functional.batch_norm(double[0], None, None, double[1], double[2], True, 0.1, 1e-4).relu()
    own = [v.clone().requires_grad_() for v in (x, scale, shift)]
    got = norm_relu(*own, 1e-4)
    close = dict(atol=1e-4, rtol=1e-4) if dtype == torch.float32 else dict(atol=1e-9, rtol=1e-9)
    torch.testing.assert_close(got.values.double(), wanted, **close)
    torch.testing.assert_close(got.mean.double(), x.double().mean(0), **close)
    torch.testing.assert_close(got.variance.double(), x.double().var(0, correction=0), **close)
    clear = direction * (wanted > 1e-3)  # away from the kink, where rounding alone decides
    grads = torch.autograd.grad((got.values * clear).sum(), own)
    expected = torch.autograd.grad((wanted * clear.double()).sum(), double)
    for mine, theirs in zip(grads, expected, strict=True):
        bound = 1e-4 if dtype == torch.float32 else 1e-9
        torch.testing.assert_close(
            mine.double(), theirs, atol=bound * shape[0] ** 0.5, rtol=1e-3 if dtype == torch.float32 else 1e-9
        )


def test_gradcheck():
    torch.manual_seed(1)
    x = torch.randn(9, 3, dtype=torch.float64, requires_grad=True)
    scale, shift = (torch.randn(3, dtype=torch.float64, requires_grad=True) for _ in range(2))
    assert torch.autograd.gradcheck(lambda *a: norm_relu(*a, 1e-4).values, (x, scale, shift))


def test_a_constant_channel_gives_its_shift():
    got = norm_relu(torch.full((5, 2), 3.0), torch.ones(2), torch.tensor([0.25, -1.0]), 1e-4)
    torch.testing.assert_close(got.values, torch.tensor([0.25, 0.0]).expand(5, 2))


def test_nan_stays_visible():
    x = torch.tensor([[1.0], [float('nan')]])
    assert bool(norm_relu(x, torch.ones(1), torch.zeros(1), 1e-4).values.isnan().all())


def test_same_bits_for_every_number_of_threads():
    x = torch.randn(PART // 4, 16, requires_grad=True)
    results = []
    try:
        for threads in (1, 3):
            torch.set_num_threads(threads)
            values = norm_relu(x, torch.ones(16), torch.zeros(16), 1e-4).values
            results.append((values, torch.autograd.grad(values.square().sum(), x)[0]))
    finally:
        torch.set_num_threads(1)
    assert torch.equal(results[0][0], results[1][0]) and torch.equal(results[0][1], results[1][1])
