"""What the paper's tables say: ``paper_tables/LABEL.csv``, LABEL being the paper's own name of the table.

The values are those of the cells; differences are always taken anew, since the paper's arrows contain slips. Where a
cell holds two values, the order of the columns is that of the values, not of a caption that says otherwise
(``table_ablation_detect_o``: its caption has KITTI first, its values have Waymo first).
"""

import csv
from functools import cache
from importlib.resources import files

from rm3d_plugin.engine.config import ConfigError

FOLDER = 'paper_tables'


@cache
def paper_table(label: str) -> dict[str, dict[str, float]]:
    """Row -> column -> value of a table; cells that the paper leaves open are not in it.

    Args:
        label: The paper's name of the table, ``table_ablation_fea_i``.

    Raises:
        ConfigError: There is no such table.
    """
    path = files('rm3d_plugin.experiments') / FOLDER / f'{label}.csv'
    if not path.is_file():
        raise ConfigError(f'no table {label!r} of the paper in {FOLDER}/')
    rows = csv.DictReader(path.read_text(encoding='utf-8').splitlines())
    return {row.pop('row'): {name: float(value) for name, value in row.items() if value} for row in rows}


def paper_value(place: str, row: str) -> float | None:
    """A value of the paper.

    Args:
        place: ``TABLE:COLUMN``; '': none.
        row: Of the table; '': none.

    Returns:
        None where the paper has no such cell.

    >>> paper_value('table_ablation_fea_i:ins_scannet', '7')
    55.1
    """
    label, _, column = place.partition(':')
    return paper_table(label).get(row, {}).get(column) if label and row else None
