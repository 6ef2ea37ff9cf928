"""``python tools/draw_labels.py ...`` is ``rm3d draw_labels ...``."""

import sys

from rm3d_plugin.commands.main import run

if __name__ == '__main__':
    sys.exit(run('draw_labels'))
