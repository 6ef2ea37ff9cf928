"""``python tools/predict.py ...`` is ``rm3d predict ...``."""

import sys

from rm3d_plugin.commands.main import run

if __name__ == '__main__':
    sys.exit(run('predict'))
