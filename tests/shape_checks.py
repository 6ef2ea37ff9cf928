"""Shape annotations are checked at run time in every module without numba kernels, which cannot be wrapped."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, get_args

import pytest
from beartype import beartype
from jaxtyping import AbstractArray, config, install_import_hook

PACKAGE = Path(__file__).resolve().parents[1] / 'rm3d_plugin'
FULLY = ('rm3d_plugin.structures', 'rm3d_plugin.models')  # every annotation, not only those of arrays
_raises = pytest.raises


def shapes(function: Callable[..., Any]) -> Callable[..., Any]:
    """Check the annotations of arrays; the others are mypy's, and a config has lists where a part says tuple."""
    function.__annotations__ = {name: hint for name, hint in function.__annotations__.items() if _is_shape(hint)}
    return beartype(function)


def _is_shape(hint: Any) -> bool:
    if isinstance(hint, type) and issubclass(hint, AbstractArray):
        return True
    return any(_is_shape(part) for part in get_args(hint))


def install() -> None:
    """Check from now on, but not inside ``pytest.raises``: what the code itself says of wrong input is tested there."""
    install_import_hook(list(FULLY), 'beartype.beartype')
    install_import_hook([name for name in checked_modules() if name not in FULLY], f'{__name__}.shapes')
    pytest.raises = _raises_unchecked


def checked_modules() -> list[str]:
    """Names for jaxtyping's import hook; a name also stands for all modules below it."""
    return _checked(PACKAGE)


def _checked(folder: Path) -> list[str]:
    if not any('numba' in path.read_text(encoding='utf-8') for path in folder.rglob('*.py')):
        return [_name(folder)]
    files = [path for path in folder.glob('*.py') if path.name != '__init__.py']
    found = [_name(path) for path in sorted(files) if 'numba' not in path.read_text(encoding='utf-8')]
    for inner in sorted(path for path in folder.iterdir() if path.is_dir() and path.name != '__pycache__'):
        found += _checked(inner)
    return found


def _name(path: Path) -> str:
    return '.'.join(path.relative_to(PACKAGE.parent).with_suffix('').parts)


@contextmanager
def _raises_unchecked(*expected: Any, **options: Any) -> Iterator[Any]:
    config.update('jaxtyping_disable', True)
    try:
        with _raises(*expected, **options) as caught:
            yield caught
    finally:
        config.update('jaxtyping_disable', False)
