"""``python tools/label.py ...`` is ``rm3d label ...``."""

import sys

from rm3d_plugin.commands.main import run

if __name__ == '__main__':
    sys.exit(run('label'))
