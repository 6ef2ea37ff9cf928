"""One BLAS thread where a result must not depend on their number, and where more only cost time."""

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np
import scipy

SUFFIXES = ('', '64_')  # names of the same functions for 32- and 64-bit indices


@cache
def _thread_controls() -> tuple[tuple[Callable[[], int], Callable[[int], None]], ...]:
    """Getter and setter of each OpenBLAS that the numpy and scipy wheels bring along."""
    controls: list[tuple[Callable[[], int], Callable[[int], None]]] = []
    for package in (np, scipy):
        home = Path(str(package.__file__)).parent
        folders = (home.parent / f'{home.name}.libs', home / '.dylibs')
        for path in sorted(p for folder in folders if folder.is_dir() for p in folder.glob('*openblas*')):
            library = ctypes.CDLL(str(path))
            for suffix in SUFFIXES:
                names = [f'scipy_openblas_{verb}_num_threads{suffix}' for verb in ('get', 'set')]
                if all(hasattr(library, name) for name in names):
                    controls.append((getattr(library, names[0]), getattr(library, names[1])))
    return tuple(controls)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Run a block with one thread in numpy's and scipy's own OpenBLAS; another BLAS keeps its setting."""
    controls = _thread_controls()
    before = [get() for get, _ in controls]
    for _, put in controls:
        put(1)
    try:
        yield
    finally:
        for (_, put), threads in zip(controls, before, strict=True):
            put(threads)
