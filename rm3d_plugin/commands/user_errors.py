"""What the user can mend ends a command with one message and exit code 2."""

import re
import sys
from collections.abc import Callable, Sequence

from rm3d_plugin.datasets.base import DatasetNotFoundError
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.storage import DamagedFileError
from rm3d_plugin.structures import SceneError


def exit_code(command: Callable[[Sequence[str] | None], None], arguments: Sequence[str] | None = None) -> int:
    """Run a command: 0 where it ends, 2 with a message where the user can mend it; anything else is a crash."""
    try:
        command(arguments)
    except (SceneError, ConfigError, DamagedFileError, DatasetNotFoundError) as error:
        print(f'error: {_without_traceback(str(error))}', file=sys.stderr)
        return 2
    return 0


def _without_traceback(text: str) -> str:
    """The message alone, where a worker process of a dataloader sent its traceback along."""
    _, separator, trace = text.partition('Original Traceback (most recent call last):\n')
    if not separator:
        return text
    return re.split(r'^[\w.]+Error: ', trace, flags=re.MULTILINE)[-1].rstrip()
