"""Names of classes. Files spell them as people type them, so they are compared without regard to letter case."""

from collections.abc import Iterable, Sequence


def class_index(name: str, classes: Sequence[str]) -> int | None:
    """Number of the class of that name, letter case aside; None where there is none.

    >>> class_index('car', ('Tree', 'Car')), class_index('bus', ('Tree', 'Car'))
    (1, None)
    """
    if name in classes:
        return list(classes).index(name)
    wanted = name.casefold()
    return next((number for number, known in enumerate(classes) if known.casefold() == wanted), None)


def one_spelling(names: Iterable[str]) -> tuple[str, ...]:
    """The first spelling of each name.

    >>> one_spelling(['Car', 'tree', 'car'])
    ('Car', 'tree')
    """
    found: dict[str, str] = {}
    for name in names:
        found.setdefault(name.casefold(), name)
    return tuple(found.values())


def check_class_names(names: Sequence[str], where: str) -> tuple[str, ...]:
    """The names, each of another class.

    Args:
        names: Of the classes, in the order of their numbers.
        where: Option or file, for the message.

    Raises:
        ValueError: Two are the same, letter case aside.
    """
    for number, name in enumerate(names):
        if (first := class_index(str(name), [str(other) for other in names[:number]])) is not None:
            raise ValueError(
                f'{where}: {names[first]!r} and {name!r} are one class, since names are compared without letter case; '
                'expected each once'
            )
    return tuple(names)
