"""The two strategies: what the paper prints, and what we add to it."""

from collections.abc import Mapping
from typing import Any, Literal, TypeVar, get_args

Strategy = Literal['default', 'paper']
RulesT = TypeVar('RulesT')


def is_paper(strategy: Strategy) -> bool:
    """Whether the method is to be the paper's alone.

    Raises:
        ValueError: There is no such strategy.
    """
    if strategy not in get_args(Strategy):
        raise ValueError(
            f'strategy: expected one of {", ".join(get_args(Strategy))}, got {strategy!r}; '
            'the numbers of merging are in `merge` (merge.gamma=.8)'
        )
    return strategy == 'paper'


def optional_rules(kind: type[RulesT], fields: Mapping[str, Any] | None) -> RulesT | None:
    """Rules from their fields; None: that part of the method is off.

    >>> optional_rules(dict, {'a': 1}), optional_rules(dict, None)
    ({'a': 1}, None)
    """
    return None if fields is None else kind(**fields)
