"""``python -m rm3d_plugin NAME ...`` is ``rm3d NAME ...``."""

import sys

from rm3d_plugin.commands.main import main

if __name__ == '__main__':
    sys.exit(main())
