"""``rm3d NAME ...``: what runs a command by its name."""

import argparse
import ast
import importlib
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from rm3d_plugin import __version__
from rm3d_plugin.commands.user_errors import exit_code

NAMES = (
    'train',
    'test',
    'predict',
    'label',
    'annotate',
    'prepare',
    'draw_labels',
    'oversegment',
    'inspect_merges',
    'reproduce',
    'bench',
    'info',
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command that the first argument names; returns the exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    parser = argparse.ArgumentParser(
        prog='rm3d',
        usage='rm3d COMMAND ...',
        description='3D scene parsing from almost no labels.',
        epilog='\n'.join(['commands:', *(f'  {name:16}{summary(name)}' for name in NAMES), '', _MORE]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--version', action='version', version=f'rm3d_plugin {__version__}')
    parser.add_argument('command', choices=NAMES, metavar='COMMAND', help='one of those below')
    return run(parser.parse_args(words[:1]).command, words[1:])


_RESUME = 'go on with --resume'
_MORE = "'rm3d COMMAND --help' tells the arguments of a command."


def summary(name: str) -> str:
    """First line of a command's docstring, read without importing the command."""
    source = Path(__file__).with_name(f'{name}.py').read_text(encoding='utf-8')
    return (ast.get_docstring(ast.parse(source)) or '').partition('\n')[0]


def run(name: str, arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code.

    Args:
        name: One of :data:`NAMES`.
        arguments: Of the command; default: those of this process.
    """
    return exit_code(partial(_run, name), arguments, _RESUME if name == 'train' else '')


def _run(name: str, arguments: Sequence[str] | None) -> None:
    importlib.import_module(f'rm3d_plugin.commands.{name}').main(arguments)


if __name__ == '__main__':
    sys.exit(main())
