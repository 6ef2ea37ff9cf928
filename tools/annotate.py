"""``python tools/annotate.py ...`` is ``rm3d annotate ...``."""

import sys

from rm3d_plugin.commands.main import run

if __name__ == '__main__':
    sys.exit(run('annotate'))
