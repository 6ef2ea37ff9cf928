"""Every epoch starts from a seed of its own, so that a resumed run draws the same numbers."""

import random

import numpy as np
import torch
from mmengine.hooks import Hook
from mmengine.runner import Runner

from rm3d_plugin.registry import HOOKS


@HOOKS.register_module()
class EpochSeedHook(Hook):
    """Seed torch, numpy and random from (run seed, epoch) before each epoch."""

    priority = 'VERY_HIGH'

    def before_train_epoch(self, runner: Runner) -> None:
        """Seed the global generators."""
        seed = int(np.random.SeedSequence([runner.seed or 0, runner.epoch]).generate_state(1)[0])
        torch.manual_seed(seed)
        np.random.seed(seed)  # noqa: NPY002  third-party code draws from it
        random.seed(seed)
