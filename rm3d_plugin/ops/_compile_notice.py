"""Says once in a process that kernels are being compiled, which happens when numba's cache on disk lacks them.

numba tells its listeners before it compiles, and stays silent when it loads from the cache: a run that finds all
kernels there neither prints nor pays anything.
"""

import sys

from numba.core import event

PACKAGE = 'rm3d_plugin'
SECONDS = 30  # processor seconds for every kernel of the geometry path; see docs/benchmarks.md


class CompileNotice(event.Listener):
    """Prints one line to stderr at the first compilation of one of our kernels."""

    def __init__(self) -> None:
        self.told = False

    def on_start(self, event: event.Event) -> None:
        """A compilation begins."""
        kernel = getattr(event.data.get('dispatcher'), 'py_func', None)
        if not self.told and getattr(kernel, '__module__', '').startswith(PACKAGE):
            self.told = True
            print(
                f'{PACKAGE}: compiling geometry kernels (once, up to about {SECONDS} s; they are kept on disk)',
                file=sys.stderr,
                flush=True,
            )

    def on_end(self, event: event.Event) -> None:
        """A compilation is done; nothing to say."""


def install() -> CompileNotice:
    """Listen to numba from now on."""
    notice = CompileNotice()
    event.register('numba:compile', notice)
    return notice
