"""Work of seconds that is given up as soon as nobody waits for its answer any more, as when a click came first."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_unwanted: ContextVar[Callable[[], bool]] = ContextVar('unwanted', default=lambda: False)


class GivenUpError(Exception):
    """The answer is not wanted any more."""


@contextmanager
def given_up_if(unwanted: Callable[[], bool]) -> Iterator[None]:
    """Let long work in the block, of this thread, end early.

    Args:
        unwanted: Asked again and again on the way.

    Raises:
        GivenUpError: From within the block, where ``unwanted`` said so.
    """
    before = _unwanted.set(unwanted)
    try:
        yield
    finally:
        _unwanted.reset(before)


def still_wanted() -> None:
    """A place where work may end early.

    Raises:
        GivenUpError: Within :func:`given_up_if`, where the answer is not wanted any more.
    """
    if _unwanted.get()():
        raise GivenUpError
