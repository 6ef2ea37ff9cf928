"""--amp on a CPU: dense layers in bfloat16, weights and steps in single precision."""

import torch
from mmengine.config import Config
from mmengine.registry import OPTIM_WRAPPERS

from rm3d_plugin.engine import CPUAutocastOptimWrapper
from rm3d_plugin.engine.run import use_amp


def test_dense_layers_run_in_bfloat16_and_weights_stay_float32():
    torch.manual_seed(0)
    model = torch.nn.Linear(4, 1)
    config = dict(type='CPUAutocastOptimWrapper', optimizer=torch.optim.SGD(model.parameters(), lr=0.1))
    wrapper = OPTIM_WRAPPERS.build(config)
    x, losses = torch.randn(64, 4), []
    for _ in range(60):
        with wrapper.optim_context(model):
            out = model(x)
            assert out.dtype == torch.bfloat16
            loss = (out.float()[:, 0] - x.sum(1)).square().mean()
        wrapper.update_params(loss)
        losses.append(loss.item())
    assert model.weight.dtype == torch.float32 and losses[-1] < 0.01 < losses[0]
    assert isinstance(wrapper, CPUAutocastOptimWrapper)


def test_without_a_gpu_the_option_means_bfloat16(monkeypatch):
    config = Config(dict(optim_wrapper=dict(type='OptimWrapper', optimizer=dict(type='Adam'))))
    monkeypatch.setattr(torch.cuda, 'is_available', lambda: False)
    use_amp(config)
    assert config.optim_wrapper.type == 'CPUAutocastOptimWrapper' and 'loss_scale' not in config.optim_wrapper
    monkeypatch.setattr(torch.cuda, 'is_available', lambda: True)
    use_amp(config)
    assert config.optim_wrapper.type == 'AmpOptimWrapper' and config.optim_wrapper.loss_scale == 'dynamic'
