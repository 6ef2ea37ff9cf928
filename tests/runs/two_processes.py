"""What the processes of a ``torchrun`` do in test_distributed.py; the first argument chooses."""

import os
import sys
from pathlib import Path

import torch

from rm3d_plugin.engine.distributed import joined_processes, use_launcher
from rm3d_plugin.models.backbones import SparseUNet

SCENES, POINTS = 4, 700


class Tiny(torch.nn.Module):
    """Labels of points by the U-Net, as a loss per scene of equal weight."""

    def __init__(self):
        super().__init__()
        self.backbone = SparseUNet(3, 0.1, (8, 12), blocks=1)
        self.head = torch.nn.Linear(8, 2)

    def forward(self, scenes):
        xyz = torch.cat(scenes)
        logits = self.head(self.backbone(xyz, xyz, torch.arange(len(scenes) + 1) * POINTS))
        return torch.nn.functional.cross_entropy(logits, (xyz[:, 0] > xyz[:, 1]).long())


def scenes():
    generator = torch.Generator().manual_seed(0)
    return [torch.rand(POINTS, 3, generator=generator) * (1 + i) for i in range(SCENES)]


def learn(model, own):
    optimizer = torch.optim.SGD(model.parameters(), lr=0.1)
    for _ in range(3):
        optimizer.zero_grad()
        model(own).backward()
        optimizer.step()


def state_of_one_process():
    torch.manual_seed(0)
    model = Tiny()
    learn(model, scenes())
    return model.state_dict()


def _learn_together(out):
    with joined_processes('pytorch'):
        rank, world = torch.distributed.get_rank(), torch.distributed.get_world_size()
        torch.manual_seed(0)
        model = Tiny()
        learn(torch.nn.parallel.DistributedDataParallel(model, broadcast_buffers=False), scenes()[rank::world])
        torch.save(model.state_dict(), Path(out) / f'{rank}.pt')


def _break_one():
    with joined_processes('pytorch'):
        if torch.distributed.get_rank() == 1:
            raise ValueError('scene 000007 is damaged')
        torch.distributed.barrier()


def _train(work_dir, world):
    sys.path[:0] = [str(Path(__file__).parents[1])]
    from runs import tiny_runs

    with joined_processes('pytorch'):
        rank = os.environ['RANK']
        make = tiny_runs.options(Path(world))
        tiny_runs.train(Path(work_dir), make, change=lambda config: (use_launcher(config, 'pytorch'), print(end='')))
        print(f'process {rank} is done')


if __name__ == '__main__':
    torch.set_num_threads(1)
    {'learn': _learn_together, 'break': _break_one, 'train': _train}[sys.argv[1]](*sys.argv[2:])
