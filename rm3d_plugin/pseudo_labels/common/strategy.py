"""The two strategies: what the paper prints, and what we add to it."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, TypeVar, get_args

from rm3d_plugin.regions import MergeRules

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


def with_gamma(merge: MergeRules, given: Mapping[str, Any] | None, gamma: float | None, owner: str) -> MergeRules:
    """The rules of merging with the confidence that another part of the method asks for.

    Args:
        merge: Rules.
        given: What the user set of them.
        gamma: What takes the place of ``merge.gamma``; None: nothing does.
        owner: Whose number that is.

    Raises:
        ValueError: The user set ``merge.gamma`` too, which would have no effect.
    """
    if gamma is None:
        return merge
    if 'gamma' in (given or {}):
        raise ValueError(
            f'MergeRules.gamma: expected to be left out where {owner}={gamma} takes its place; set that one'
        )
    return replace(merge, gamma=gamma)


def optional_rules(kind: type[RulesT], fields: Mapping[str, Any] | None) -> RulesT | None:
    """Rules from their fields; None: that part of the method is off.

    >>> optional_rules(dict, {'a': 1}), optional_rules(dict, None)
    ({'a': 1}, None)
    """
    return None if fields is None else kind(**fields)
