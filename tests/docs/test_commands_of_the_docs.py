"""Every command in a bash block of README and docs is one: its options exist, and its config has the keys it changes.

None is run here: their parsers read them. What a command does is tested beside it (``tests/commands``).
"""

import argparse
import copy
import importlib
import re
import shlex
from pathlib import Path

import pytest

from rm3d_plugin.commands.main import NAMES
from rm3d_plugin.engine import config as configs
from rm3d_plugin.engine.config_files import find_config

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / 'README.md', *sorted((ROOT / 'docs').glob('*.md'))]
OPTIONAL = re.compile(r'\[([^\[\]]*)\]')
KNOWN: dict = {}


class Parsed(Exception):
    """What a command's parser made of its arguments."""


def commands_of(text: str) -> list[str]:
    """Lines of the bash blocks, those that end with a backslash joined with the next, without comments."""
    lines = []
    for block in re.findall(r'^ *```bash\n(.*?)^ *```', text, re.MULTILINE | re.DOTALL):
        lines += block.replace('\\\n', ' ').splitlines()
    return [' '.join(line.split()) for line in lines if line.strip() and not line.lstrip().startswith('#')]


def named(line: str) -> tuple[str, list[str]] | None:
    """Name and arguments of one of our commands; None for another program's. Brackets are optional arguments."""
    plain = line
    while (shorter := OPTIONAL.sub(without_dots, plain)) != plain:  # from the inside
        plain = shorter
    words = shlex.split(plain, comments=True)
    while words and re.fullmatch(r'[A-Z0-9_]+=.*', words[0]):
        words = words[1:]
    if words[:1] == ['rm3d'] and len(words) > 1 and not words[1].startswith('-') and words[1] != 'COMMAND':
        return words[1], words[2:]
    if words[:1] == ['python'] and (tool := re.fullmatch(r'tools/(\w+)\.py', words[1])):
        return tool[1], words[2:]
    return None


def without_dots(found: re.Match) -> str:
    """Optional arguments as given, [--data ...] left out; lists like [16,32] stay."""
    inside = found[1]
    if '...' in inside:
        return ''
    return inside if ' ' in inside or inside.startswith('-') else f'<{inside}>'


FOUND = [(page.name, line) for page in PAGES for line in commands_of(page.read_text(encoding='utf-8'))]
OURS = [(page, line) for page, line in FOUND if named(line) is not None]


def parsed(name: str, words: list[str], monkeypatch) -> argparse.Namespace:
    """What the command's own parser says; nothing is run."""
    read = argparse.ArgumentParser.parse_args

    def stop(self, args=None, namespace=None):
        raise Parsed(read(self, args, namespace))

    with monkeypatch.context() as patch, pytest.raises(Parsed) as told:
        patch.setattr(argparse.ArgumentParser, 'parse_args', stop)
        importlib.import_module(f'rm3d_plugin.commands.{name}').main(words)
    return told.value.args[0]


@pytest.mark.parametrize(('page', 'line'), OURS, ids=[f'{page}: {line[:70]}' for page, line in OURS])
def test_a_command_of_the_docs_is_one(page, line, monkeypatch, capsys):
    name, words = named(line)
    assert name in NAMES and (ROOT / 'tools' / f'{name}.py').is_file()
    try:
        args = parsed(name, words, monkeypatch)
    except SystemExit:
        pytest.fail(f'{page}: {line}: {capsys.readouterr().err.splitlines()[-1]}')
    if 'config' in args and 'cfg_options' in args and shipped(args.config):
        config = copy.deepcopy(read(args.config))
        configs._apply(config, args.cfg_options or {})


def shipped(config: str | None) -> bool:
    """Whether a config comes with RM3D: CONFIG, $config.py, my_scan.py and that of the tutorial are the reader's."""
    own = ('my_', 'mine', 'mean_teacher_')
    return config is not None and not config.isupper() and '$' not in config and not config.startswith(own)


def read(name: str):
    """A config as its files have it, read once."""
    path = find_config(name if not name.startswith('configs/') else ROOT / name)
    if path not in KNOWN:
        KNOWN[path] = configs._read(path)
    return KNOWN[path]


def test_make_targets_of_the_docs_exist():
    targets = set(re.findall(r'^([\w-]+):', (ROOT / 'Makefile').read_text(), re.MULTILINE))
    asked = {
        target
        for page in PAGES
        for target in re.findall(r'`make ([\w-]+)`|^make ([\w-]+)', page.read_text(), re.MULTILINE)
        for target in target
        if target
    }
    assert asked and asked <= targets


def test_every_command_stands_in_the_docs_and_every_page_in_the_navigation():
    assert {named(line)[0] for _, line in OURS} | {'prepare'} == set(NAMES) - {'bench'} | {'bench'}
    navigation = (ROOT / 'mkdocs.yml').read_text()
    assert all(f'{page.name}' in navigation for page in PAGES if page.parent == ROOT / 'docs')


def test_how_lines_are_read():
    text = 'x\n```bash\nA=1 rm3d test CONFIG \\\n    CHECKPOINT [--flip both]   # why\n# no\nls\n```\n'
    assert commands_of(text) == ['A=1 rm3d test CONFIG CHECKPOINT [--flip both] # why', 'ls']
    assert named(commands_of(text)[0]) == ('test', ['CONFIG', 'CHECKPOINT', '--flip', 'both'])
    assert named('ls') is None and named('rm3d --help') is None
    assert named('python tools/train.py X [--a ...]') == ('train', ['X'])
