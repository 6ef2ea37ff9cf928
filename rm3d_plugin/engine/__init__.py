"""When things happen: hooks, loops, runs. No maths."""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rm3d_plugin.engine.autocast import CPUAutocastOptimWrapper as CPUAutocastOptimWrapper
    from rm3d_plugin.engine.loops import RoundTrainLoop as RoundTrainLoop

# Public name -> module that holds it; imported when first asked for, so that reading a config takes no torch.
_PUBLIC = {'CPUAutocastOptimWrapper': 'autocast', 'RoundTrainLoop': 'loops'}
__all__ = ['CPUAutocastOptimWrapper', 'RoundTrainLoop']  # noqa: PLE0604


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(importlib.import_module(f'{__name__}.{_PUBLIC[name]}'), name)
