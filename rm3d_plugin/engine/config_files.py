"""Where config files lie: a user's own by path, those that come with RM3D by name."""

import difflib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mmengine.config import Config

from rm3d_plugin.engine.renamed_options import RENAMED_CONFIGS
from rm3d_plugin.user_error import ConfigError as ConfigError

PACKAGE = Path(__file__).resolve().parents[1]
SHIPPED = f'{PACKAGE.name}::'


def shipped_configs() -> Path:
    """Folder of the configs that come with RM3D: in a wheel inside the package, in a checkout beside it."""
    inside = PACKAGE / 'configs'
    return inside if inside.is_dir() else PACKAGE.parent / 'configs'


def shipped_leaves() -> dict[str, Path]:
    """The configs that can be run, by name."""
    found = sorted(shipped_configs().rglob('*.py'))
    return {path.stem: path for path in found if '_base_' not in path.parts}


def find_config(name: str | Path) -> Path:
    """The file that a name means.

    Args:
        name: A path; or ``rm3d_plugin::NAME.py`` or ``NAME`` for a config that comes with RM3D, wherever it lies there.

    Raises:
        ConfigError: There is none.
    """
    text = str(name)
    if text.startswith(SHIPPED):
        return shipped_config(text.removeprefix(SHIPPED))
    if Path(text).is_file() or '/' in text:
        return Path(text)
    leaves = shipped_leaves()
    return leaves.get(text, leaves.get(text.removesuffix('.py'), Path(text)))


def shipped_config(name: str) -> Path:
    """A file of :func:`shipped_configs` by its path there, or a leaf by its name alone; ``.py`` may be left out.

    Raises:
        ConfigError: There is none.
    """
    path = shipped_configs() / f'{name.removesuffix(".py")}.py'
    if path.is_file():
        return path
    if path.stem in shipped_leaves() and path.parent == shipped_configs():
        return shipped_leaves()[path.stem]
    raise ConfigError(f'{SHIPPED}{name}: no such config{similar(name)}')


def similar(name: str | Path) -> str:
    """The end of a message about a name that is none: which shipped config may have been meant."""
    if (new := RENAMED_CONFIGS.get(Path(name).stem)) is not None:
        return f'; it is now {new}'
    near = difflib.get_close_matches(Path(name).stem, list(shipped_leaves()), n=3)
    return f'; did you mean {" or ".join(near)}?' if near else f'; those of RM3D are in {shipped_configs()}'


@contextmanager
def shipped_bases() -> Iterator[None]:
    """Within this block ``_base_ = 'rm3d_plugin::NAME.py'`` is read; mmengine reads its own family's packages alone.

    A page that goes on from itself, maybe by way of others, is a ConfigError: mmengine would read until Python stops.
    """
    mmengines = Config._get_cfg_path
    bases: dict[Path, set[Path]] = {}

    def path_and_scope(base: str, filename: str) -> tuple[str, str | None]:
        found: tuple[str, str | None]
        if base.startswith(SHIPPED):
            found = str(shipped_config(base.removeprefix(SHIPPED))), None
        else:
            found = mmengines(base, filename)
        page, goes_on_from = Path(filename).resolve(), Path(found[0]).resolve()
        bases.setdefault(page, set()).add(goes_on_from)
        if page in _all_bases(goes_on_from, bases):
            raise ConfigError(f'{page}: _base_ leads back to this page: {base!r}; take it out')
        return found

    Config._get_cfg_path = staticmethod(path_and_scope)
    try:
        yield
    finally:
        Config._get_cfg_path = staticmethod(mmengines)


def _all_bases(page: Path, bases: Mapping[Path, set[Path]]) -> set[Path]:
    """A page and what it goes on from, as far as it was met."""
    found, ahead = set[Path](), [page]
    while ahead:
        here = ahead.pop()
        ahead += bases.get(here, set()) - found
        found.add(here)
    return found


@contextmanager
def pages_merge() -> Iterator[None]:
    """Within this block pages and options go on from others by our rules, stricter and easier than mmengine's.

    A dict may follow None or a word (``columns = dict(...)`` after ``columns = None``) without ``_delete_``; but not a
    reference (``'${name}'``), since who gives keys of one may mean to change what it refers to. A number, a list or a
    switch stays one.
    """
    mmengines = Config._merge_a_into_b

    def merge(new: dict[str, Any], old: Any, allow_list_keys: bool = False) -> Any:
        if isinstance(old, dict):
            _check_kinds(new, old)
            gone = [key for key, value in new.items() if _lacks_base(value) and _is_plain(old.get(key, 0))]
            old = old.copy()
            for key in gone:
                del old[key]
        return mmengines(new, old, allow_list_keys)

    Config._merge_a_into_b = staticmethod(merge)
    try:
        yield
    finally:
        Config._merge_a_into_b = staticmethod(mmengines)


def _is_plain(value: Any) -> bool:
    return value is None or (isinstance(value, str) and '${' not in value)


def _lacks_base(value: Any) -> bool:
    return isinstance(value, dict) and '_delete_' not in value


KINDS: tuple[tuple[str, tuple[type, ...]], ...] = (
    ('True or False', (bool,)),
    ('a number', (int, float)),
    ('a list', (list, tuple)),
    ('text', (str,)),
)


def _check_kinds(new: Mapping[str, Any], old: Mapping[str, Any]) -> None:
    """Refuse a plain value of another kind than the one that it replaces; None and references may stand anywhere."""
    for key, value in new.items():
        before, after = _kind(old.get(key)), _kind(value)
        if before is not None and after is not None and after not in (before, _one_of(old[key])):
            raise ConfigError(f'{key}: expected {before}, as {old[key]!r} is, got {value!r}')


def _one_of(before: Any) -> str | None:
    """What may stand for a list of one, and a list for it."""
    if isinstance(before, list | tuple):
        return _kind(before[0]) if before else None
    return 'a list' if _kind(before) == 'a number' else None


def _kind(value: Any) -> str | None:
    """None: it may be replaced by anything."""
    if isinstance(value, str) and '${' in value:
        return None
    return next((name for name, types in KINDS if isinstance(value, types)), None)
