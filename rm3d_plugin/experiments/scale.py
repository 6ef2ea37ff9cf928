"""Tables made smaller, so that they end in a given time: fewer scenes, fewer epochs, fewer seeds, by measured costs."""

import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np

from rm3d_plugin.baselines import Task
from rm3d_plugin.engine.config import ConfigError, load_config
from rm3d_plugin.experiments.kept import kept_rows
from rm3d_plugin.experiments.run_commands import config_path, option_texts, parse_options
from rm3d_plugin.experiments.runner import Commands, duration, plan, run_folder, run_rows, seeds_of
from rm3d_plugin.experiments.spec import DEMO, WHOLE, AnyTable, MeasuredTable, Request, Row, Scale, Table
from rm3d_plugin.storage import read_json

COUNTS = ('num_train', 'num_val', 'rooms_per_area')  # of the demo's scenes, as its makers name them
FEWEST_POINTS = 3000  # of a measured scene
FEWEST = {'num_train': 4, 'num_val': 2, 'rooms_per_area': 1}
AREAS = 6  # of S3DIS
PLACES = ('data_root', 'val_dataloader.dataset.data_root')


def ladder(seeds: int) -> list[Scale]:
    """From the whole to the smallest: scenes and epochs first, then parts; seeds later, since signs are tested on them.

    Args:
        seeds: That are asked for.
    """
    shares = ((1.0, 1.0), (0.5, 1.0), (0.5, 0.5), (0.25, 0.5), (0.25, 0.25), (0.125, 0.25))
    whole = [Scale(*share, seeds) for share in shares]
    few = [Scale(*shares[-1], seeds, parts) for parts in (6, 3, 1)]
    fewer = [Scale(*shares[-1], fewer, 1) for fewer in range(seeds - 1, 0, -1)]
    return [*whole, *few, *fewer, *(Scale(*shares[-1], 1, 1, rows) for rows in (8, 5, 3))]


class Cost(NamedTuple):
    """What a kind of run costs, seconds.

    Attributes:
        kind: Its config, without the budget.
        start: Of a run, whatever its size.
        step: Of a scene and epoch.
        labels: Of a scene, each time its labels are made.
    """

    kind: str
    start: float
    step: float
    labels: float


class Size(NamedTuple):
    """How much a run does: training scenes, epochs, and how often labels are made."""

    scenes: int
    epochs: int
    refreshes: int


def sized(row: Row, scale: Scale) -> dict[str, Any]:
    """Options that make the runs of a row as small as asked; {} for the whole.

    Args:
        row: Trained on a demo.
        scale: How small.

    Raises:
        ConfigError: The row is trained on real data.
    """
    config = _demo_config(row)
    if scale.scenes == scale.epochs == 1.0:
        return {}
    counts = {
        f'demo_data.{name}': max(FEWEST[name], round(config['demo_data'][name] * scale.scenes))
        for name in COUNTS
        if name in config['demo_data']
    }
    sigma = max(1, round(config['sigma'] * scale.epochs))
    periods = [round(period * sigma / config['sigma']) for period in config['periods']]
    return {**counts, 'data_root': _smaller_place(config['data_root'], scale), 'sigma': sigma, 'periods': periods}


def scaled_row(row: Row, scale: Scale) -> Row:
    """The row with smaller runs."""
    options = sized(row, scale)
    if not options:
        return row
    test = None if row.test is None else {**row.test, **_smaller_places(row.test, scale)}
    return replace(row, options={**row.options, **options}, test=test)


def scaled_table(table: AnyTable, scale: Scale) -> AnyTable:
    """The table with fewer rows and smaller runs, and a note that says so; measured ones read the request instead."""
    few, note = fewer_rows(table, scale), f'Smaller than the demo: {scale}.'
    if isinstance(few, MeasuredTable):
        return few
    if isinstance(few, Table):
        return replace(few, rows=_scaled_rows(few.rows, scale), notes=(*few.notes, note))
    parts = tuple(replace(part, rows=_scaled_rows(part.rows, scale)) for part in few.parts)
    return replace(few, parts=parts, notes=(*few.notes, note))


def fewer_rows(table: AnyTable, scale: Scale) -> AnyTable:
    """The table with so few parts and rows as a scale says, and all that their runs tell besides."""
    if isinstance(table, MeasuredTable):
        return table
    if isinstance(table, Table):
        needed = {table.reference, *(row.against for row in table.rows)}
        return replace(table, rows=spread_rows(table.rows, needed, scale.rows))
    chosen = [
        replace(part, rows=spread_rows(part.rows, {part.base}, scale.rows)) for part in table.parts[: scale.parts]
    ]
    made = {_run_of(row) for part in chosen for row in part.rows}
    told = [
        replace(part, rows=tuple(row for row in part.rows if _run_of(row) in made))
        for part in table.parts[len(chosen) :]
        if any(row.name == part.base and _run_of(row) in made for row in part.rows)
    ]
    return replace(table, parts=(*chosen, *(part for part in told if len(part.rows) > 1)))


def _run_of(row: Row) -> tuple[Path, str]:
    """What a row trains and tests, of any seed."""
    return run_folder(Path(), row, 0), '' if row.test is None else str(option_texts(row.test))


def scaled_request(request: Request, scale: Scale) -> Request:
    """The request with fewer seeds and, for measured tables, fewer scenes and points."""
    points = None if request.points is None else max(FEWEST_POINTS, round(request.points * scale.scenes))
    return replace(
        request,
        seeds=tuple(request.seeds)[: scale.seeds],
        scenes=max(1, round(request.scenes * scale.scenes)),
        points=points,
        scale=scale,
    )


def spread_rows(rows: Sequence[Row], needed: Collection[str | None], count: int) -> tuple[Row, ...]:
    """At most so many rows, in their order: those that are needed, then others evenly from the first to the last.

    Args:
        rows: From the top.
        needed: Names of rows that stay.
        count: Of rows; more where more are needed.
    """
    others = [row.name for row in rows if row.name not in needed]
    left = min(count - (len(rows) - len(others)), len(others))
    chosen = {others[round(at)] for at in np.linspace(0, len(others) - 1, left)} if left > 0 else set[str]()
    return tuple(row for row in rows if row.name in needed or row.name in chosen)


def _scaled_rows(rows: Sequence[Row], scale: Scale) -> tuple[Row, ...]:
    return tuple(scaled_row(row, scale) for row in rows)


def size_of(row: Row, scale: Scale) -> Size:
    """How much a run of a row does at a scale."""
    small = {key: value for key, value in sized(row, scale).items() if key.startswith('demo_data')}
    config = _demo_config(row)
    demo = {**config['demo_data'], **{key.partition('.')[2]: value for key, value in small.items()}}
    scenes = demo['num_train'] if 'num_train' in demo else demo['rooms_per_area'] * (AREAS - 1)
    sigma = max(1, round(config['sigma'] * scale.epochs))
    refreshes = row.options.get('label_refreshes') or config['label_refreshes']
    return Size(scenes, config['rounds'] * sigma, refreshes)


def seconds_of(cost: Cost, size: Size) -> float:
    """Time of a run on the clock."""
    return cost.start + size.scenes * (size.epochs * cost.step + size.refreshes * cost.labels)


def choose_scale(
    tables: Sequence[AnyTable], request: Request, minutes: float, commands: Commands | None = None
) -> Scale:
    """The largest scale at which the runs of some tables end in time; kept in ``out``, so that a resumed table stays.

    One short run of each kind is trained and timed.

    Args:
        tables: All that are to be made.
        request: Seeds and runs at a time.
        minutes: On the clock.
        commands: What trains.
    """
    path = request.out / 'budget.json'
    asked = {'minutes': minutes, 'jobs': request.jobs, 'seeds': list(request.seeds), 'options': list(request.options)}

    def measure() -> list[tuple[Any, ...]]:
        began = time.monotonic()
        costs = measure_costs([row for table in tables for row in table.rows], request, commands)
        return [astuple(fitting(tables, request, costs, 60 * minutes - (time.monotonic() - began)))]

    scale = Scale(*kept_rows(path, asked, _plain_row, measure)[0])
    request.log(f'{minutes:g} minutes: {scale}')
    return scale


def fitting(tables: Sequence[AnyTable], request: Request, costs: Mapping[str, Cost], seconds: float) -> Scale:
    """The first rung of the ladder that ends in time, else the last, which is told.

    Args:
        tables: All that are to be made.
        request: Seeds and runs at a time.
        costs: Of each kind of run.
        seconds: There are.
    """
    for scale in ladder(len(request.seeds)):
        needed = needed_seconds(tables, request, costs, scale)
        if needed <= seconds:
            break
    else:
        request.log(f'even the smallest takes {duration(needed)}')
    return scale


def needed_seconds(tables: Sequence[AnyTable], request: Request, costs: Mapping[str, Cost], scale: Scale) -> float:
    """Time that all trainings and tests of some tables take at a scale, those that they share once."""
    small, seconds = scaled_request(request, scale), dict[tuple[Path, str], float]()
    for table in tables:
        for row in fewer_rows(table, scale).rows:
            cost, size = costs[kind_of(row)], size_of(row, scale)
            for seed in (request.seed,) if isinstance(table, MeasuredTable) else seeds_of(row, small):
                folder = run_folder(request.out, row, seed)
                seconds[folder, ''] = seconds_of(cost, size)
                if row.test is not None:
                    seconds[folder, str(option_texts(row.test))] = cost.start
    return sum(seconds.values()) / request.jobs


def measure_costs(rows: Sequence[Row], request: Request, commands: Commands | None = None) -> dict[str, Cost]:
    """Kind of run -> its cost, by one short training of each kind; finished ones are not trained again."""
    firsts: dict[str, Row] = {}
    for row in sorted(rows, key=lambda row: not row.config.startswith('rm3d')):
        firsts.setdefault(kind_of(row), row)
    tiny = {kind: probe_row(row) for kind, row in firsts.items()}
    one = replace(request, out=request.out / 'probes', seeds=request.seeds[:1])
    found = {kind: _probe(kind, row, one, commands) for kind, row in tiny.items()}
    start = min(cost.start for cost in found.values())  # the others made their scenes, or compiled
    return {kind: cost._replace(start=start) for kind, cost in found.items()}


def probe_row(row: Row) -> Row:
    """The shortest run of a kind: the fewest scenes, an epoch a round."""
    config = _demo_config(row)
    whole = next(config['demo_data'][name] for name in COUNTS if name in config['demo_data'])
    return scaled_row(replace(row, test=None, seeds=None), Scale(1 / whole, 1 / config['sigma']))


def kind_of(row: Row) -> str:
    """What a run's cost depends on: task and data set, and whether it learns from all labels.

    A compared method is taken to cost what RM3D does; its pre-training, which runs share, is not counted.
    """
    words = Path(row.config).stem.split('_')
    at = next((number for number, word in enumerate(words) if word in get_args(Task)), 1)
    return '_'.join([*words[at : at + 2], *(['full'] if words[-1] == 'full' else [])])


def _probe(kind: str, row: Row, request: Request, commands: Commands | None) -> Cost:
    path, folder = request.out / f'{kind}.json', run_folder(request.out, row, request.seeds[0])
    specs = plan([row], request)

    def measure() -> list[Cost]:
        began = time.monotonic()
        run_rows([row], request, commands)
        return [cost_of(kind, read_json(folder / 'timing.json'), time.monotonic() - began, size_of(row, WHOLE).scenes)]

    return kept_rows(path, specs[0].spec, Cost, measure)[0]


def cost_of(kind: str, timing: Mapping[str, Any], seconds: float, scenes: int) -> Cost:
    """What a short run tells: its last epoch and its last labels, as the first also compile.

    Args:
        kind: Of the run.
        timing: Its ``timing.json``.
        seconds: That it took in all.
        scenes: It learnt from.
    """
    epochs = [entry['wall'] for entry in timing['epochs'].values()]
    labels = [entry['wall'] for entry in timing['labels'].values()]
    start = max(seconds - sum(epochs) - sum(labels), 0.0) + epochs[0] - epochs[-1] + labels[0] - labels[-1]
    return Cost(kind, max(start, 0.0), epochs[-1] / scenes, labels[-1] / scenes)


_KNOWN: dict[str, dict[str, Any]] = {}


def _demo_config(row: Row) -> dict[str, Any]:
    """What of a row's demo config its size depends on; read once for each config and data."""
    if row.train is None or not set(DEMO) <= set(row.train):
        raise ConfigError(f'{row.config}: --budget-minutes makes demos smaller; real data are as large as they are')
    names = ('demo_data', 'sigma', 'rounds', 'periods', 'label_refreshes', 'data_root')
    changed = {key: row.options[key] for key in row.options if key.split('.')[0] in names}
    texts = option_texts(changed)
    key = f'{row.config} {sorted(texts.items())}'
    if key not in _KNOWN:
        config = load_config(config_path(row.config), demo=True, options=parse_options(texts))
        _KNOWN[key] = {name: config.get(name) for name in names}
    return _KNOWN[key]


def _smaller_place(root: str, scale: Scale) -> str:
    return f'{root}_x{scale.scenes:.3g}'


def _smaller_places(options: Mapping[str, Any], scale: Scale) -> dict[str, str]:
    return {key: _smaller_place(options[key], scale) for key in PLACES if key in options}


def _plain_row(*row: Any) -> tuple[Any, ...]:
    return row
