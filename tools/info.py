"""``python tools/info.py ...`` is ``rm3d info ...``."""

import sys

from rm3d_plugin.commands.main import run

if __name__ == '__main__':
    sys.exit(run('info'))
