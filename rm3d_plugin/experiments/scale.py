"""Tables made smaller, so that they end in a given time: fewer scenes, fewer epochs, fewer seeds, by measured costs."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, get_args

from rm3d_plugin.baselines import Task
from rm3d_plugin.engine.config import ConfigError, load_config
from rm3d_plugin.experiments.kept import kept_rows
from rm3d_plugin.experiments.run_commands import config_path, option_texts, parse_options
from rm3d_plugin.experiments.runner import Commands, duration, plan, run_folder, run_rows
from rm3d_plugin.experiments.spec import DEMO, PaperTable, Request, Row, Table
from rm3d_plugin.storage import read_json

COUNTS = ('num_train', 'num_val', 'rooms_per_area')  # of the demo's scenes, as its makers name them
FEWEST = {'num_train': 4, 'num_val': 2, 'rooms_per_area': 1}
AREAS = 6  # of S3DIS
PLACES = ('data_root', 'val_dataloader.dataset.data_root')


@dataclass(frozen=True)
class Scale:
    """How large the runs of a table are.

    Attributes:
        scenes: Share of the demo's scenes.
        epochs: Share of the epochs of a round.
        seeds: How many of those that are asked for.
    """

    scenes: float
    epochs: float
    seeds: int

    def __str__(self) -> str:
        return f'{self.scenes:g} of the scenes, {self.epochs:g} of the epochs, {self.seeds} seeds'


def ladder(seeds: int) -> list[Scale]:
    """From the whole to the smallest: scenes and epochs shrink before seeds do, since signs are tested over seeds."""
    shares = ((1.0, 1.0), (0.5, 1.0), (0.5, 0.5), (0.25, 0.5), (0.25, 0.25), (0.125, 0.25))
    whole = [Scale(*share, seeds) for share in shares]
    return [*whole, *(Scale(0.125, 0.25, fewer) for fewer in range(seeds - 1, 0, -1))]


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
    if (scale.scenes, scale.epochs) == (1.0, 1.0):
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


def scaled_table(table: Table | PaperTable, scale: Scale) -> Table | PaperTable:
    """The table with smaller runs."""
    if isinstance(table, Table):
        return replace(table, rows=tuple(scaled_row(row, scale) for row in table.rows))
    parts = tuple(replace(part, rows=tuple(scaled_row(row, scale) for row in part.rows)) for part in table.parts)
    return replace(table, parts=parts, notes=(*table.notes, f'Smaller than the demo: {scale}.'))


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


def choose_scale(rows: Sequence[Row], request: Request, minutes: float, commands: Commands | None = None) -> Scale:
    """The largest scale at which the runs of some rows end in time; kept in ``out``, so that a resumed table stays.

    One short run of each kind is trained and timed.

    Args:
        rows: Of all tables that are to be made.
        request: Seeds and runs at a time.
        minutes: On the clock.
        commands: What trains.
    """
    path = request.out / 'budget.json'
    asked = {'minutes': minutes, 'jobs': request.jobs, 'seeds': list(request.seeds), 'options': list(request.options)}

    def measure() -> list[tuple[float, float, int]]:
        costs = measure_costs(rows, request, commands)
        scale = fitting(rows, request, costs, 60 * minutes)
        return [(scale.scenes, scale.epochs, scale.seeds)]

    scenes, epochs, seeds = kept_rows(path, asked, _plain_row, measure)[0]
    scale = Scale(scenes, epochs, int(seeds))
    request.log(f'{minutes:g} minutes: {scale}')
    return scale


def fitting(rows: Sequence[Row], request: Request, costs: Mapping[str, Cost], seconds: float) -> Scale:
    """The first rung of the ladder that ends in time, else the last, which is told.

    Args:
        rows: Of all tables.
        request: Seeds and runs at a time.
        costs: Of each kind of run.
        seconds: There are.
    """
    for scale in ladder(len(request.seeds)):
        needed = needed_seconds(rows, request, costs, scale)
        if needed <= seconds:
            return scale
    request.log(f'even the smallest takes {duration(needed)}; the last tables may be left out')
    return scale


def needed_seconds(rows: Sequence[Row], request: Request, costs: Mapping[str, Cost], scale: Scale) -> float:
    """Time that all runs of some rows take at a scale, runs that they share once."""
    one = replace(request, seeds=request.seeds[:1])
    by_folder = {run_folder(one.out, row, one.seeds[0]): row for row in rows if row.train is not None}
    each = [seconds_of(costs[kind_of(row)], size_of(row, scale)) for row in by_folder.values()]
    return sum(each) * scale.seeds / request.jobs


def measure_costs(rows: Sequence[Row], request: Request, commands: Commands | None = None) -> dict[str, Cost]:
    """Kind of run -> its cost, by one short training of each kind; finished ones are not trained again."""
    firsts: dict[str, Row] = {}
    for row in sorted(rows, key=lambda row: not row.config.startswith('rm3d')):
        firsts.setdefault(kind_of(row), row)
    tiny = {kind: probe_row(row) for kind, row in firsts.items()}
    one = replace(request, out=request.out / 'probes', seeds=request.seeds[:1])
    return {kind: _probe(kind, row, one, commands) for kind, row in tiny.items()}


def probe_row(row: Row) -> Row:
    """The shortest run of a kind: the fewest scenes, an epoch a round."""
    config = _demo_config(row)
    whole = next(config['demo_data'][name] for name in COUNTS if name in config['demo_data'])
    return scaled_row(replace(row, test=None, seeds=None), Scale(1 / whole, 1 / config['sigma'], 1))


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
        return [cost_of(kind, read_json(folder / 'timing.json'), time.monotonic() - began, size_of(row, _WHOLE).scenes)]

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


_WHOLE = Scale(1.0, 1.0, 1)
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
