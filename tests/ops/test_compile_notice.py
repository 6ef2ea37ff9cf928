"""The notice comes once, when a kernel is really compiled, and never when the cache has it."""

import os
import subprocess
import sys

CODE = (
    'import numpy as np\n'
    'from rm3d_plugin.ops.morton import morton_codes\n'
    'points = np.zeros((2, 3)); morton_codes(points); morton_codes(points)\n'
)


def test_one_line_with_an_empty_cache_and_none_with_a_filled_one(tmp_path):
    environment = {**os.environ, 'NUMBA_CACHE_DIR': str(tmp_path), 'NUMBA_NUM_THREADS': '1'}

    def told():
        done = subprocess.run([sys.executable, '-c', CODE], env=environment, capture_output=True, text=True, check=True)
        return [line for line in done.stderr.splitlines() if 'compiling geometry kernels' in line]

    assert len(told()) == 1
    assert told() == []
