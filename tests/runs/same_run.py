"""Whether two runs left the same, bit for bit."""

from pathlib import Path

import torch


def assert_same_run(folder: Path, other: Path, epoch: int = 2) -> None:
    """Metrics, the last checkpoint, and every file of the label store."""
    assert (folder / 'metrics.json').read_bytes() == (other / 'metrics.json').read_bytes()
    ours, theirs = (torch.load(f / f'epoch_{epoch}.pth', weights_only=True) for f in (folder, other))
    for part in ('state_dict', 'optimizer', 'param_schedulers'):
        assert_same(ours.get(part), theirs.get(part), part)
    assert ours['meta']['epoch'] == theirs['meta']['epoch'] == epoch
    names = sorted(path.relative_to(folder / 'labels') for path in (folder / 'labels').rglob('*') if path.is_file())
    assert names == sorted(p.relative_to(other / 'labels') for p in (other / 'labels').rglob('*') if p.is_file())
    for name in names:
        assert (folder / 'labels' / name).read_bytes() == (other / 'labels' / name).read_bytes(), name


def assert_same(ours, theirs, where) -> None:
    """Nested values with tensors."""
    if isinstance(ours, dict):
        assert ours.keys() == theirs.keys(), where
        for key in ours:
            assert_same(ours[key], theirs[key], f'{where}.{key}')
    elif isinstance(ours, list):
        assert len(ours) == len(theirs), where
        for i, pair in enumerate(zip(ours, theirs, strict=True)):
            assert_same(*pair, f'{where}[{i}]')
    elif isinstance(ours, torch.Tensor):
        assert torch.equal(ours, theirs), where
    else:
        assert ours == theirs, where
