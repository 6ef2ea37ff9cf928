"""``python tools/test.py ...`` is ``rm3d test ...``."""

import sys

from rm3d_plugin.commands.main import run

if __name__ == '__main__':
    sys.exit(run('test'))
