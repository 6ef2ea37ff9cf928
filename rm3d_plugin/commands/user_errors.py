"""What the user can mend ends a command with one message and exit code 2; an interrupt with 130."""

import re
import sys
from collections.abc import Callable, Sequence

from rm3d_plugin.user_error import UserError

MENDABLE, INTERRUPTED = 2, 130


def exit_code(
    command: Callable[[Sequence[str] | None], None], arguments: Sequence[str] | None = None, hint: str = ''
) -> int:
    """Run a command: 0 where it ends, 2 with a message where the user can mend it; anything else is a crash.

    Args:
        command: What is run.
        arguments: Of the command.
        hint: What to do after an interrupt (exit code 130).
    """
    try:
        command(arguments)
    except UserError as error:
        return _told(str(error))
    except OSError as error:  # a full disk, a folder that is read-only, a file where a folder should be
        place = ' -> '.join(str(name) for name in (error.filename, error.filename2) if name is not None)
        return _told(f'{place}: {error.strerror}' if place and error.strerror else f'{type(error).__name__}: {error}')
    except MemoryError as error:
        return _told(f'out of memory ({error}); use a smaller scan or crop, or smaller max_points')
    except KeyboardInterrupt:
        print(f'stopped{"; " * bool(hint)}{hint}', file=sys.stderr)
        return INTERRUPTED
    return 0


def _told(text: str) -> int:
    print(f'error: {_without_traceback(text)}', file=sys.stderr)
    return MENDABLE


def _without_traceback(text: str) -> str:
    """The message alone, where a worker process of a dataloader sent its traceback along."""
    _, separator, trace = text.partition('Original Traceback (most recent call last):\n')
    if not separator:
        return text
    return re.split(r'^[\w.]+Error: ', trace, flags=re.MULTILINE)[-1].rstrip()
