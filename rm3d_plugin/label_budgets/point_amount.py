"""How many points a budget shows, and the names by which users ask for it (METHOD 8)."""

import ast
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from rm3d_plugin.label_budgets.base import BudgetError

_NAME = re.compile(
    r'(?P<full>full)|(?P<one>onept)(?P<of_instance>_instance)?|(?P<points>\d+)pts(?P<of_class>_class)?'
    r'|(?P<scenes>scenes)?(?P<percent>\d+(p\d+)?)pct'
)
_NO_INSTANCES = '_no_instances'
KNOWN_NAMES = (
    'onept, onept_instance, 20pts, 50pts, 100pts, 200pts, 5pts_class, 0p03pct, 0p2pct, 0p4pct, 0p6pct, 0p8pct, 1pct, '
    'scenes1pct, scenes5pct, scenes10pct, scenes20pct, full'
)


@dataclass(frozen=True)
class PointAmount:
    """How much is annotated: exactly one field beside ``instances`` is given.

    Attributes:
        percent: Share of the labelled points of every scene in (0, 100], in per cent; at least one point of each class
            that the scene holds, even where that is more.
        per_scene: Points of every scene; where a scene holds more classes than that, the classes drawn first get one
            each and the others none.
        per_class: Points of each class in every scene (1: what the paper calls 0.03 %).
        per_instance: Points of each instance in every scene, and of each class that has none.
        scene_percent: Share of the scenes that are labelled completely, in (0, 100], in per cent; at least one scene.
        point_list: File of points for each scene, see :func:`rm3d_plugin.label_budgets.read_point_list`.
        scene_list: Text file of the scenes that are labelled completely, one name a line.
        clicks: File of labels that a person gave, see :func:`rm3d_plugin.storage.read_clicks`.
        instances: False hides the instance numbers (unsupervised instances); classes are annotated all the same.

    Raises:
        ValueError: None or several are given, or one is out of range.
    """

    percent: float | None = None
    per_scene: int | None = None
    per_class: int | None = None
    per_instance: int | None = None
    scene_percent: float | None = None
    point_list: str | None = None
    scene_list: str | None = None
    clicks: str | None = None
    instances: bool = True

    def __post_init__(self) -> None:
        choices = [item.name for item in fields(self) if item.name != 'instances']
        given = [name for name in choices if getattr(self, name) is not None]
        if len(given) != 1:
            raise BudgetError(f'label budget: expected exactly one of {", ".join(choices)}, got {given or "none"}')
        name, value = given[0], getattr(self, given[0])
        if name.endswith('percent'):
            good, expected = isinstance(value, int | float) and 0 < value <= 100, 'a number in (0, 100]'
        elif name.startswith('per_'):
            good, expected = isinstance(value, int) and not isinstance(value, bool) and value >= 1, 'a number from 1'
        else:
            good, expected = isinstance(value, str) and bool(value), 'the name of a file'
        if not good:
            raise BudgetError(f'label budget {name}: expected {expected}, got {value!r}')

    @property
    def everything(self) -> bool:
        """True where every label is annotated."""
        return 100 in (self.percent, self.scene_percent)

    @property
    def file(self) -> str | None:
        """The file that says what is annotated; None where it is drawn."""
        return self.point_list or self.scene_list or self.clicks

    def to_plain(self) -> dict[str, Any]:
        """The fields as plain JSON values."""
        return asdict(self)


def point_amount(budget: str | Mapping[str, Any] | PointAmount) -> PointAmount:
    """The amount of a name ('onept', '20pts', '0p2pct', 'scenes5pct', 'full', ...) or of fields.

    Any number may stand in a name (``p`` is the decimal point); ``_no_instances`` behind a name hides the instances.
    Text may name fields too, as a command line does: ``clicks=my.csv``, ``percent=0.3,instances=False``.

    Raises:
        BudgetError: No such name or field, or a number out of range.

    >>> point_amount('0p2pct').percent
    0.2
    >>> point_amount('20pts_no_instances') == PointAmount(per_scene=20, instances=False)
    True
    """
    if isinstance(budget, PointAmount):
        return budget
    if isinstance(budget, str) and '=' in budget:
        budget = _fields_of(budget)
    if isinstance(budget, Mapping):
        known = [item.name for item in fields(PointAmount)]
        if unknown := sorted(set(budget) - set(known)):
            raise BudgetError(f'label budget: expected fields among {", ".join(known)}, got {", ".join(unknown)}')
        return PointAmount(**budget)
    words = _NAME.fullmatch(str(budget).removesuffix(_NO_INSTANCES))
    if words is None:
        raise BudgetError(f'label budget: expected one of {KNOWN_NAMES} (or another number), got {budget!r}')
    return PointAmount(**_field_of(words), instances=not str(budget).endswith(_NO_INSTANCES))


def _fields_of(text: str) -> dict[str, Any]:
    fields_of = dict(part.split('=', 1) for part in text.split(',') if '=' in part)
    return {name.strip(): _value(value.strip()) for name, value in fields_of.items()}


def _value(text: str) -> Any:
    """A number or truth value where the text is one."""
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text


def _field_of(words: re.Match[str]) -> dict[str, Any]:
    if words['full']:
        return {'percent': 100.0}
    if words['one']:
        return {'per_instance' if words['of_instance'] else 'per_class': 1}
    if words['points']:
        return {'per_class' if words['of_class'] else 'per_scene': int(words['points'])}
    return {'scene_percent' if words['scenes'] else 'percent': float(words['percent'].replace('p', '.'))}
