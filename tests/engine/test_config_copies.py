"""mmengine reads a copy of each page: no copy stays open or on the disk, whatever the page does."""

import re
import tempfile
import weakref
from pathlib import Path

import pytest

from rm3d_plugin.engine.config import ConfigError, load_config, read_settings

HIDDEN = """
def fall(): raise ValueError('first')
try: fall()
except ValueError: raise KeyError('second')
"""
PAGES = {
    'raises.py': 'x = 1 / 0\n',
    'stops.py': 'raise SystemExit(3)\n',
    'open.py': 'x = (\n',
    'latin.py': 'x = "für"\n'.encode('latin-1'),
    'hides.py': HIDDEN,
    'itself.py': "_base_ = 'itself.py'\n",
    'circle.py': "_base_ = ['plain.py', 'round.py']\n",
    'round.py': "_base_ = './circle.py'\n",
    'plain.py': 'x = 1\n',
    'again.py': "_base_ = ['plain.py', 'plain.py']\n",
    'shipped.py': "_base_ = 'rm3d_plugin::nosuch.py'\n",
    'above.py': "_base_ = 'raises.py'\n",
    'above_open.py': "_base_ = 'open.py'\n",
    'above_latin.py': "_base_ = 'latin.py'\n",
    'above_stops.py': "_base_ = 'stops.py'\n",
}
SAID = {
    'raises.py': 'ZeroDivisionError: division by zero',
    'stops.py': 'SystemExit: 3',
    'above_open.py': "SyntaxError: '(' was never closed",
    'above_latin.py': 'UnicodeDecodeError',
    'hides.py': "KeyError: 'second'",
    'itself.py': "itself.py: _base_ leads back to this page: 'itself.py'; take it out",
    'circle.py': "round.py: _base_ leads back to this page: './circle.py'; take it out",
    'again.py': 'Duplicate key',
    'shipped.py': 'rm3d_plugin::nosuch.py: no such config',
    'above.py': 'ZeroDivisionError',
    'above_stops.py': 'SystemExit: 3',
}


@pytest.fixture
def copies(tmp_path, monkeypatch):
    """Names of the temporary files made while pages are read, and references that do not keep them open."""
    made, make = {}, tempfile.NamedTemporaryFile

    def noting(*args, **options):
        file = make(*args, **options)
        made[file.name] = weakref.ref(file)
        return file

    monkeypatch.setattr(tempfile, 'NamedTemporaryFile', noting)
    for name, text in PAGES.items():
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return made


@pytest.mark.parametrize('name', SAID)
def test_no_copy_of_a_page_stays(name, copies, tmp_path):
    with pytest.raises(ConfigError, match=re.escape(SAID[name])) as caught:
        load_config(tmp_path / name)
    assert 1 <= len(copies) <= 3 and str(tmp_path / name) in str(caught.value)
    assert not any(Path(copy).exists() or Path(copy).parent.exists() for copy in copies)
    assert [copy() for copy in copies.values()] == [None] * len(copies)


def test_settings_are_read_as_they_stand(copies, tmp_path):
    (tmp_path / 'leaf.py').write_text("_base_ = 'plain.py'\ny = '${x}'\n")
    assert read_settings(tmp_path / 'leaf.py').to_dict() == {'x': 1, 'y': '${x}'}
    assert len(copies) == 2 and not any(Path(copy).exists() for copy in copies)
