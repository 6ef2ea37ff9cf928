"""A compared method as a spec: which config trains it, and what it changes of RM3D's."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

Task = Literal['sem', 'ins', 'votenet']
Declared = Literal['label-aware sampling', 'budget grows', 'second view', 'pre-training', 'regions']
LABELS: dict[Task, str] = {'sem': 'points', 'ins': 'points', 'votenet': 'boxes'}


@dataclass(frozen=True)
class Baseline:
    """A compared method.

    Attributes:
        name: Its folder in ``rm3d_plugin/baselines``.
        title: Row of a table; ``{labels}`` stands for points or boxes.
        leaf: Name of its configs; ``{task}``, ``{data}`` and ``{budget}`` are filled in.
        options: Task -> the config keys in which it differs from ``rm3d_{task}_{data}_{budget}``.
        declares: What it does that others do not. All else is common: network, labels, schedule, augmentation, and how
            scenes are sampled; tests hold that.
    """

    name: str
    title: str
    leaf: str
    options: Mapping[Task, Mapping[str, Any]]
    declares: tuple[Declared, ...] = ()

    def config(self, task: Task, data: str, budget: str) -> str:
        """Name of the config leaf.

        Args:
            task: sem, ins or votenet.
            data: Data set, as configs name it: scannet, kitti, ...
            budget: Label budget, as configs name it: 0p2pct, onept, ...
        """
        return self.leaf.format(task=task, data=data, budget=budget)

    def row(self, task: Task) -> str:
        """Name of its row in a table of a task."""
        return self.title.format(labels=LABELS[task])

    @property
    def readme(self) -> Path:
        """Its README."""
        return Path(__file__).parent / self.name / 'README.md'
