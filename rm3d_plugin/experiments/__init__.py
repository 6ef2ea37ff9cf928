"""Tables of the documentation as specs.

``spec`` says what a row and a table are, ``tables/`` holds them, ``runner`` trains and tests their runs, ``scores``
reads the records, ``paper`` knows the paper's numbers and ``compare`` tells them beside ours, ``scale`` makes runs
smaller, ``render`` prints; ``reproduce`` is all of it. ``scenes`` are what measured tables measure.
"""

from rm3d_plugin.experiments.render import FORMATS, FilledTable, Format, to_format
from rm3d_plugin.experiments.reproduce import list_tables, make_all, make_table
from rm3d_plugin.experiments.spec import MeasuredTable, PaperTable, Part, Request, Row, Table, method_rows
from rm3d_plugin.experiments.tables import TABLES

__all__ = [
    'FORMATS',
    'TABLES',
    'FilledTable',
    'Format',
    'MeasuredTable',
    'PaperTable',
    'Part',
    'Request',
    'Row',
    'Table',
    'list_tables',
    'make_all',
    'make_table',
    'method_rows',
    'to_format',
]
