"""Training in rounds: sigma epochs on one set of pseudo labels, then the next set."""

from typing import Any

from mmengine.runner import EpochBasedTrainLoop, Runner

from rm3d_plugin.registry import LOOPS


@LOOPS.register_module()
class RoundTrainLoop(EpochBasedTrainLoop):
    """``rounds`` rounds of ``sigma`` epochs (METHOD 1); otherwise mmengine's epoch loop.

    Args:
        runner: The runner.
        dataloader: Training dataloader or its config.
        rounds: How often the labels are renewed, the first time included.
        sigma: Epochs a round.
        val_rounds: Validate after every so many rounds; the last round is always validated.
    """

    def __init__(self, runner: Runner, dataloader: Any, rounds: int, sigma: int, val_rounds: int = 1) -> None:
        for name, value in (('rounds', rounds), ('sigma', sigma), ('val_rounds', val_rounds)):
            if int(value) < 1:
                raise ValueError(f'RoundTrainLoop.{name}: expected at least 1, got {value}')
        super().__init__(runner, dataloader, max_epochs=rounds * sigma, val_interval=val_rounds * sigma)
