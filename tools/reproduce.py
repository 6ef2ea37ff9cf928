"""``python tools/reproduce.py ...`` is ``rm3d reproduce ...``."""

import sys

from rm3d_plugin.commands.main import run

if __name__ == '__main__':
    sys.exit(run('reproduce'))
