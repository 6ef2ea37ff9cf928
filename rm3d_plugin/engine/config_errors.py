"""Which errors of building parts are the user's to mend, and which are ours."""

import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from mmengine.config import Config

from rm3d_plugin.engine.config_files import PACKAGE, ConfigError
from rm3d_plugin.user_error import UserError


@contextmanager
def config_errors(config: Config) -> Iterator[None]:
    """Turn what a wrong type or setting raises while parts are built into a :class:`ConfigError`.

    A part refuses what it is given by a ValueError or an AssertionError, and mmengine and torch by any error. A
    TypeError, KeyError or AttributeError counts only where it comes from a constructor, which is where settings arrive,
    or from a function that hands its numbers on from there; deeper in our code it is a fault of the program and stays
    what it is, traceback and all.
    """
    try:
        yield
    except UserError:
        raise
    except (ValueError, AssertionError) as error:
        raise _mendable(config, error) from error
    except (TypeError, KeyError, AttributeError) as error:
        places = _innermost(error)
        place = next((frame for frame in places if frame.f_code.co_name in CONSTRUCTORS), None)
        if not places or place is not None or UNEXPECTED in str(error):
            raise _mendable(config, error, place) from error
        raise


CONSTRUCTORS = ('__init__', '__post_init__', 'check_field', 'check_positive', 'add_losses', 'build', 'build_loops')
UNEXPECTED = 'got an unexpected keyword argument'


def _innermost(error: Exception) -> list[FrameType]:
    """The frames of our package nearest to an error, below the block that builds: of TypeErrors the innermost two."""
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)][2:]  # config_errors, and who uses it
    ours = [frame for frame in frames if Path(frame.f_code.co_filename).is_relative_to(PACKAGE)]
    return ours[: -3 if isinstance(error, TypeError) else -2 : -1]


def _mendable(config: Config, error: Exception, place: FrameType | None = None) -> ConfigError:
    text = str(error.args[0]) if error.args else type(error).__name__
    what = text.partition('. Please check')[0]
    part = None if place is None or place.f_code.co_name not in CONSTRUCTORS[:2] else place.f_locals.get('self')
    named = what if part is None else f'{type(part).__name__}: a value of the wrong kind ({what})'
    return ConfigError(f'{config.get("config_name", "config")}: {named}; correct the config or option')
