"""Options of the command line as KEY=VALUE words."""

import argparse
from collections.abc import Sequence
from typing import Any

from mmengine.config import DictAction


class KeyValues(DictAction):
    """mmengine's action; a word that is none is told as other wrong arguments are, not by a traceback."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> None:
        """Collect the words.

        Raises:
            argparse.ArgumentError: A word has no key or no equals sign, or brackets in a value do not fit.
        """
        for word in values or ():
            if not word.partition('=')[0].strip() or '=' not in word:
                raise argparse.ArgumentError(self, f'expected KEY=VALUE, got {word!r}')
            try:
                super().__call__(parser, namespace, [word], option_string)
            except (AssertionError, ValueError, IndexError) as error:
                raise argparse.ArgumentError(self, f'{word}: {error or "not a value"}') from error
