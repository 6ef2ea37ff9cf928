"""What a project has of its own is not installed a second time."""

import subprocess
import sys

from runs.tiny_runs import ROOT

TELL = """
import runpy, setuptools
setuptools.setup = lambda **told: print(told['install_requires'], told['extras_require']['standalone'], sep='\\n')
runpy.run_path('setup.py', run_name='__main__')
"""
HIDE = """
import importlib.util
find = importlib.util.find_spec
importlib.util.find_spec = lambda name: None if name == 'mmengine' else find(name)
import rm3d_plugin
"""


def python(text):
    return subprocess.run([sys.executable, '-W', 'ignore', '-c', text], cwd=ROOT, capture_output=True, text=True)


def test_neither_mmengine_nor_opencv_is_required():
    required, standalone = python(TELL).stdout.splitlines()
    assert 'numpy>=1.26,<3' in required and 'mmengine' not in required and 'opencv' not in required
    assert 'mmengine-lite' in standalone and 'opencv-python-headless' in standalone


def test_a_missing_mmengine_is_told():
    told = python(HIDE).stderr.splitlines()[-1]
    assert told.startswith(
        'ImportError: rm3d_plugin needs mmengine: install mmengine, or mmengine-lite with any package'
    )
