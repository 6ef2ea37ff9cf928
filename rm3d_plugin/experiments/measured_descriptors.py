"""How tables of descriptors are measured: collection by collection and row by row; what was measured is kept."""

import re
import time
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any, NamedTuple

from rm3d_plugin.descriptors import Descriptor
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments.compared_descriptors import build_descriptor
from rm3d_plugin.experiments.kept import descriptor_asked, kept_rows
from rm3d_plugin.experiments.render import FilledTable, save
from rm3d_plugin.experiments.scenes import Collection, load_collections
from rm3d_plugin.experiments.spec import Request


class Entry(NamedTuple):
    """One row of such a table.

    Attributes:
        title: As the table prints it.
        descriptor: Type name.
        measure: Descriptor, collection and what makes the things that all rows see -> what is measured.
    """

    title: str
    descriptor: str
    measure: Callable[[Descriptor, Collection, Callable[[], Any]], list[Any]]


class Measured(NamedTuple):
    """What one such table measures.

    Attributes:
        name: Of the table.
        kind: Of what is measured; its fields are plain values.
        entries: The rows.
        shared: Collection and seed -> what all rows see: pairs of scans, say.
        fill: What is measured, and the seed -> the table.
    """

    name: str
    kind: Callable[..., Any]
    entries: Sequence[Entry]
    shared: Callable[[Collection, int], Any]
    fill: Callable[[Sequence[Any], int], FilledTable]


def measure_table(table: Measured, request: Request) -> FilledTable:
    """Measure every row on every collection; after each the table is written with what there is.

    Args:
        table: What is measured.
        request: Its ``data`` are keys of :data:`rm3d_plugin.experiments.scenes.COLLECTIONS`; its seed draws all that is
            drawn.

    Raises:
        ConfigError: None of the data are there.
    """
    rows: list[Any] = []
    for collection in load_collections(request):
        shared = cache(partial(table.shared, collection, request.seed))
        for entry in table.entries:
            start = time.process_time()
            rows += _kept(table, entry, collection, shared, request)
            save(table.fill(rows, request.seed), request.out, table.name)
            request.log(f'{collection.title}: {entry.title}: {time.process_time() - start:.0f} CPU s')
    if not rows:
        raise ConfigError(f'nothing to measure: none of {", ".join(request.data)} is there')
    return table.fill(rows, request.seed)


def _kept(
    table: Measured, entry: Entry, collection: Collection, shared: Callable[[], Any], request: Request
) -> list[Any]:
    part, slug = build_descriptor(entry.descriptor, collection), re.sub(r'[^A-Za-z]+', '-', entry.title)
    path = request.out / 'measured' / f'{table.name}_{collection.name}_{slug}.json'
    return kept_rows(
        path, descriptor_asked(request, part), table.kind, partial(entry.measure, part, collection, shared)
    )
