"""Training in several processes, started by ``torchrun``: on GPUs over NCCL, on CPUs over gloo."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta

import torch
import torch.distributed as dist
from mmengine.config import Config

from rm3d_plugin.engine.config import ConfigError

# Others wait while one process prepares scenes; a process that dies ends the job at once, whatever this says.
PATIENCE = timedelta(days=2)


@contextmanager
def joined_processes(launcher: str) -> Iterator[None]:
    """Join the other processes of a ``torchrun`` for a block; nothing happens with launcher ``'none'``.

    An error tells which process it came from. ``torchrun`` then ends the others.

    Raises:
        ConfigError: The process was not started by a launcher that names its rank, or has no GPU of its own.
    """
    if launcher != 'pytorch':  # mmengine joins those of slurm and MPI
        yield
        return
    missing = [name for name in ('RANK', 'WORLD_SIZE', 'MASTER_ADDR', 'MASTER_PORT') if name not in os.environ]
    if missing:
        raise ConfigError(
            f'--launcher pytorch: {", ".join(missing)} not set; start with '
            '`torchrun --nproc_per_node N -m rm3d_plugin train CONFIG --launcher pytorch`'
        )
    if torch.cuda.is_available():
        local, found = int(os.environ.get('LOCAL_RANK', 0)), torch.cuda.device_count()
        if local >= found:
            raise ConfigError(
                f'--launcher pytorch: process {local} of this machine needs a GPU of its own, and {found} were found; '
                f"start {found} processes (--nproc_per_node {found}), or set CUDA_VISIBLE_DEVICES='' to use CPUs"
            )
        torch.cuda.set_device(local)
    dist.init_process_group('nccl' if torch.cuda.is_available() else 'gloo', timeout=PATIENCE)
    try:
        yield
    except BaseException as error:
        place = f'process {dist.get_rank()} of {dist.get_world_size()}'
        print(f'{place} ended with {type(error).__name__}: {error}', file=sys.stderr, flush=True)
        raise
    else:
        dist.destroy_process_group()


def use_launcher(config: Config, launcher: str) -> None:
    """Wrap the model for several processes; its batch statistics are of all of them, as our CPU layers' are anyway."""
    config.launcher = launcher
    devices = [int(os.environ['LOCAL_RANK'])] if torch.cuda.is_available() else None
    config.model_wrapper_cfg = dict(
        type='MMDistributedDataParallel', device_ids=devices, broadcast_buffers=False, find_unused_parameters=True
    )
    if devices is not None:
        config.sync_bn = 'torch'
