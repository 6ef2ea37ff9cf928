"""Print versions, threads, devices, and which data sets are where: what a report of a fault needs."""

import argparse
import ast
import os
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from rm3d_plugin import __version__
from rm3d_plugin.engine.config_files import shipped_configs

PACKAGES = ('torch', 'numpy', 'numba', 'scipy', 'mmengine', 'mmengine-lite', 'opencv-python-headless', 'spconv')
EXTRAS = {'annotate': 'viser', 'las': 'laspy', 'e57': 'pye57', 'waymo': 'pyarrow', 'superpoints': 'cut-pursuit-py'}
REAL_DATA = 'RM3D_REAL_DATA'  # environment variable; folder of real scans for tables and tests
SHOWN = 16  # characters of a line's name


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the arguments and print."""
    parser = argparse.ArgumentParser(prog='rm3d info', description=__doc__)
    parser.parse_args(arguments)
    print('\n'.join([*versions(), '', *devices(), '', *data_sets(Path.cwd())]))


def versions() -> list[str]:
    """A line for this package, Python and each package that matters; what is not there is left out."""
    found = {name: _version(name) for name in PACKAGES}
    extras = {name: package for name, package in EXTRAS.items() if _version(package) is not None}
    return [
        _line('rm3d_plugin', f'{__version__} in {Path(__file__).resolve().parents[1]}'),
        _line('Python', f'{platform.python_version()}, {platform.platform()}'),
        *(_line(name, told) for name, told in found.items() if told is not None),
        _line('extras', ', '.join(extras) or 'none'),
    ]


def devices() -> list[str]:
    """Processor, cores and threads, and each GPU."""
    import torch  # takes seconds: not for --help

    from rm3d_plugin.experiments.benchmarks.measure import machine
    from rm3d_plugin.ops._parallel import free_cores

    facts = machine()
    gpus = [torch.cuda.get_device_name(number) for number in range(torch.cuda.device_count())]
    return [
        _line('processor', f'{facts["processor"]}, {facts["cores"]} cores, {free_cores()} free for this process'),
        _line('threads', f'torch {facts["torch_threads"]}, numba {facts["numba_threads"]}; threads=0 takes all free'),
        _line('GPU', ', '.join(gpus) or 'none'),
    ]


def data_sets(folder: Path) -> list[str]:
    """A line for each data set that a config reads: where it is looked for, and whether it is there.

    Args:
        folder: That relative places start from.
    """
    real = os.environ.get(REAL_DATA)
    lines = [_line(name, _there(folder / root, root)) for name, root in known_data().items()]
    return [*lines, _line(REAL_DATA, _there(Path(real), real) if real else 'not set')]


def known_data() -> dict[str, str]:
    """Page of the configs -> its ``data_root``, read without running it."""
    found = {}
    for path in sorted((shipped_configs() / '_base_').glob('*.py')):
        for node in ast.parse(path.read_text(encoding='utf-8')).body:
            if isinstance(node, ast.Assign) and [ast.unparse(target) for target in node.targets] == ['data_root']:
                root = ast.literal_eval(node.value)
                if root is not None:
                    found[path.stem] = str(root)
    return found


def _there(place: Path, told: str) -> str:
    return f'{told}: {"there" if place.is_dir() else "not there; data_root=FOLDER, or --demo"}'


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _line(name: str, text: str) -> str:
    return f'{name:<{SHOWN}} {text}'
