"""``python tools/inspect_merges.py ...`` is ``rm3d inspect_merges ...``."""

import sys

from rm3d_plugin.commands.main import run

if __name__ == '__main__':
    sys.exit(run('inspect_merges'))
