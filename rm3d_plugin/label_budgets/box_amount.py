"""How many boxes are annotated (METHOD 8), and the names of the amounts that papers use."""

import re
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from rm3d_plugin.label_budgets.base import BudgetError


@dataclass(frozen=True)
class BoxAmount:
    """How many boxes are annotated: exactly one of the first three.

    Attributes:
        per_scene: Boxes for each scene on average (0.2 = two per ten scenes).
        fraction: Share of all boxes in (0, 1]; 1 shows everything, and scenes then count as completely labelled.
        each: So many objects in every scene that has them, and no more.
        scenes: Share of the scenes in (0, 1] that are labelled at all; they are drawn first, and the numbers above are
            about them alone.
        alike: Classes take turns, so that each has as many annotated boxes as another while it has usable ones, as a
            person would choose who labels a few; False: frequent classes are drawn more often.
    """

    per_scene: float | None = None
    fraction: float | None = None
    alike: bool = False
    each: int | None = None
    scenes: float = 1.0

    def __post_init__(self) -> None:
        if sum(value is not None for value in (self.per_scene, self.fraction, self.each)) != 1:
            raise ValueError(f'BoxAmount: expected one of per_scene, fraction and each, got {self}')
        if self.per_scene is not None and not 0 < self.per_scene < np.inf:
            raise ValueError(f'BoxAmount.per_scene: expected a number above 0, got {self.per_scene}')
        if self.each is not None and self.each < 1:
            raise ValueError(f'BoxAmount.each: expected at least 1, got {self.each}')
        for name in ('fraction', 'scenes'):
            share = getattr(self, name)
            if share is not None and not 0 < share <= 1:
                raise ValueError(f'BoxAmount.{name}: expected a share in (0, 1], got {share}')

    @property
    def everything(self) -> bool:
        """True where nothing of the labelled scenes stays hidden."""
        return self.fraction == 1

    def count(self, scenes: int, boxes: int) -> int:
        """Boxes to show of so many scenes with so many boxes, at least one."""
        if self.each is not None:
            return self.each * scenes
        wanted = self.per_scene * scenes if self.per_scene is not None else (self.fraction or 0.0) * boxes
        return max(1, round(wanted))

    def to_plain(self) -> dict[str, Any]:
        """Plain values; what is as by default and came later is left out, so that older budgets keep their hash."""
        plain = asdict(self)
        later = {'alike': False, 'each': None, 'scenes': 1.0}
        return {name: value for name, value in plain.items() if name not in later or value != later[name]}


BOX_BUDGETS = {  # METHOD 8: two boxes per ten scenes are called 1 %, one per ten 0.5 %
    '1pct': BoxAmount(per_scene=0.2),
    '0p5pct': BoxAmount(per_scene=0.1),
    '3pct': BoxAmount(fraction=0.03),
    'full': BoxAmount(fraction=1.0),
    'onebox': BoxAmount(each=1),  # one object in each scene, as SS3D, CoIn and CPDet3D
    '2pct': BoxAmount(each=1, scenes=0.1),  # one object in a tenth of the scenes: these papers' 2 % of KITTI
}
_PATTERN = re.compile(r'(?:(?P<onebox>onebox)_)?scenes(?P<share>\d+(?:p\d+)?)pct')
_CHOICES = f'{", ".join(BOX_BUDGETS)}, scenes10pct (any number), onebox_scenes10pct; each may end with _alike'


def box_amount(name: str) -> BoxAmount:
    """The amount of a name.

    Args:
        name: A key of :data:`BOX_BUDGETS`; 'scenes10pct': 10 % of the scenes, labelled completely;
            'onebox_scenes10pct': one object in each of them; with '_alike' behind, classes take turns.

    Raises:
        BudgetError: There is no such amount.
    """
    plain = name.removesuffix('_alike')
    if plain in BOX_BUDGETS:
        return replace(BOX_BUDGETS[plain], alike=plain != name)
    found = _PATTERN.fullmatch(plain)
    share = float(found['share'].replace('p', '.')) / 100 if found else 0.0
    if found is None or not 0 < share <= 1:
        raise BudgetError(f'label budget: expected one of {_CHOICES}, got {name!r}')
    one = found['onebox'] is not None
    return BoxAmount(fraction=None if one else 1.0, each=1 if one else None, scenes=share, alike=plain != name)
