"""Shape annotations are checked at run time in every module without numba kernels, which cannot be wrapped."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from beartype import BeartypeConf, beartype
from jaxtyping import config, install_import_hook

PACKAGE = Path(__file__).resolve().parents[1] / 'rm3d_plugin'
typechecker = beartype(conf=BeartypeConf(is_pep484_tower=True))  # an int may stand where a float is expected
_raises = pytest.raises


def install() -> None:
    """Check from now on, but not inside ``pytest.raises``: what the code itself says of wrong input is tested there."""
    install_import_hook(checked_modules(), f'{__name__}.typechecker')
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
