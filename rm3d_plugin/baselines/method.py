"""Specs of methods by what they add to the labels alone, or to RM3D."""

from collections.abc import Mapping
from typing import Any

from rm3d_plugin.baselines.base import Baseline, Declared, Task
from rm3d_plugin.baselines.labelled_only import LABELLED_ONLY


def method(
    name: str, title: str, parts: Mapping[Task, Mapping[str, Any]], declares: tuple[Declared, ...] = ()
) -> Baseline:
    """A method that learns from the labelled points or boxes alone, and from parts of its own.

    Args:
        name: See :class:`Baseline`, as the next.
        title: Row of a table.
        parts: Task -> config keys that it adds to those of the labels alone, or sets otherwise.
        declares: See :class:`Baseline`.
    """
    options = {task: {**LABELLED_ONLY.options[task], **own} for task, own in parts.items()}
    return Baseline(name, title, f'{name}_{{task}}_{{data}}_{{budget}}', options, declares)


def with_rm3d(baseline: Baseline, parts: Mapping[Task, Mapping[str, Any]]) -> Baseline:
    """RM3D with the parts of a method.

    Args:
        baseline: The method.
        parts: Task -> config keys in which it differs from RM3D.
    """
    leaf = f'rm3d_{baseline.name}_{{task}}_{{data}}_{{budget}}'
    return Baseline(baseline.name, f'RM3D + {baseline.title}', leaf, parts, baseline.declares)
