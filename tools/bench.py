"""``python tools/bench.py ...`` is ``rm3d bench ...``."""

import sys

from rm3d_plugin.commands.main import run

if __name__ == '__main__':
    sys.exit(run('bench'))
