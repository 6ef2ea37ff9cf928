"""What can be told of a page of settings by reading it: names that nothing uses, and where its paths start."""

import ast
import difflib
import os
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from mmengine.config import Config

from rm3d_plugin.engine.config_files import SHIPPED, ConfigError, shipped_config, shipped_configs

PATHS = ('data_root', 'load_from', 'budget.clicks', 'budget.point_list', 'budget.scene_list')
NEAR = 0.8  # of difflib; from here on a name was meant to be another


class Page(NamedTuple):
    """A config file.

    Attributes:
        path: The file.
        assigned: Names that it gives a value at its top level.
        read: Names that it reads itself.
        bases: Files that it goes on from.
    """

    path: Path
    assigned: frozenset[str]
    read: frozenset[str]
    bases: tuple[Path, ...]

    @property
    def shipped(self) -> bool:
        """Whether it comes with RM3D."""
        return self.path.resolve().is_relative_to(shipped_configs().resolve())


def read_page(path: Path) -> Page:
    """Look at a page that mmengine could read."""
    tree = ast.parse(path.read_text(encoding='utf-8-sig'))
    names = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
    targets = [node for statement in tree.body for node in _targets(statement)]
    read = frozenset(node.id for node in names if isinstance(node.ctx, ast.Load))
    return Page(path, frozenset(targets), read, tuple(_bases(tree, path)))


def _targets(statement: ast.stmt) -> list[str]:
    """Names that a statement of the top level gives a value, also within ``if`` and ``for``."""
    return [node.id for node in ast.walk(statement) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)]


def _bases(tree: ast.Module, path: Path) -> Iterator[Path]:
    for statement in tree.body:
        if not isinstance(statement, ast.Assign) or '_base_' not in _targets(statement):
            continue
        named = ast.literal_eval(statement.value)
        for name in [named] if isinstance(named, str) else named:
            if name.startswith(SHIPPED):
                yield shipped_config(name.removeprefix(SHIPPED))
            elif '::' not in name:
                yield path.parent / name


def pages(path: Path) -> list[Page]:
    """A page and all that it goes on from, itself first."""
    first = read_page(path)
    return [first, *(page for base in first.bases for page in pages(base))]


def check_names(config: Config, found: list[Page]) -> None:
    """Refuse or tell a name of the user's own page that nothing reads: a slip of the pen, most likely.

    Args:
        config: Read, references not resolved yet.
        found: From :func:`pages`.

    Raises:
        ConfigError: It is almost that of another key.

    Warns:
        UserWarning: It is not.
    """
    first, bases = found[0], found[1:]
    if first.shipped or not any(page.shipped for page in bases):
        return
    known = frozenset[str]().union(*(page.assigned for page in bases))
    text = str(config.to_dict())
    for name in sorted(first.assigned - known - first.read - _OTHERS):
        if name.startswith('_') or f'${{{name}' in text:
            continue
        near = difflib.get_close_matches(name, sorted(known), n=1, cutoff=NEAR)
        if near:
            raise ConfigError(f'{first.path}: {name}: nothing reads it; did you mean {near[0]}?')
        warnings.warn(f'{first.path}: {name}: no config of RM3D has such a key, and nothing refers to it', stacklevel=2)


_OTHERS = frozenset(
    'work_dir load_from resume launcher log_processor test_dataloader test_evaluator test_cfg auto_scale_lr '
    'randomness compile experiment_name'.split()
)
"""Keys of mmengine's runner that no config of ours need have."""


def anchor_paths(config: Config, found: list[Page]) -> None:
    """Let relative paths of a user's own pages start at the page's folder, whatever the working directory is.

    Args:
        config: Changed in place; command-line options, whose paths start at the working directory, come later.
        found: From :func:`pages`.
    """
    for key in PATHS:
        first, *rest = key.split('.')
        owner = next((page for page in found if first in page.assigned), None)
        holder: Any = config
        for word in (first, *rest)[:-1]:
            holder = holder.get(word) if isinstance(holder, dict | Config) else None
        name = (first, *rest)[-1]
        value = holder.get(name) if isinstance(holder, dict | Config) else None
        if owner is not None and not owner.shipped and isinstance(value, str) and '${' not in value:
            holder[name] = _from_folder(value, owner.path.parent)


def _from_folder(path: str, folder: Path) -> str:
    """The path seen from the working directory where it lies below it, else in full."""
    full = Path(os.path.abspath(folder / Path(path).expanduser()))
    return str(full.relative_to(Path.cwd())) if full.is_relative_to(Path.cwd()) else str(full)
