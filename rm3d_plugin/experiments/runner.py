"""Trains and tests the runs of a table: finished ones are kept, a killed table goes on, one failure stops no other."""

import os
import re
import shutil
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from rm3d_plugin.engine.config import ConfigError, load_config
from rm3d_plugin.engine.hooks.run_record_hook import read_record
from rm3d_plugin.engine.hooks.safe_checkpoint_hook import latest_checkpoint
from rm3d_plugin.experiments.run_commands import option_texts, parse_options, split_options, test_command, train_command
from rm3d_plugin.experiments.spec import DEMO, Request, Row
from rm3d_plugin.experiments.warm_start import WarmStart
from rm3d_plugin.storage import content_key, read_json, write_json

SPEC = 'spec.json'  # beside a run: what was asked for
HOW_NOT_WHAT = ('threads', 'cache_dir')  # options that change no result
LONGEST_NAME = 80  # characters of the options in a folder's name


class Commands(NamedTuple):
    """What trains (config -> command) and what tests (config, checkpoint -> command)."""

    train: Callable[[str], list[str]] = train_command
    test: Callable[[str, str], list[str]] = test_command


@dataclass(frozen=True)
class Run:
    """One training, and the tests of its network.

    Attributes:
        config: Leaf or file.
        arguments: Of the train command; None: nothing is trained.
        options: Config keys as text, the user's among them.
        seed: Of the training and the label budget.
        folder: Work directory.
        tests: Folder in the work directory -> config keys of the test as text.
    """

    config: str
    arguments: tuple[str, ...] | None
    options: Mapping[str, str]
    seed: int
    folder: Path
    tests: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    @property
    def spec(self) -> dict[str, Any]:
        """What makes its result; a run with another one is another run."""
        options = {key: text for key, text in sorted(self.options.items()) if key not in HOW_NOT_WHAT}
        return {
            'config': Path(self.config).stem,
            'arguments': list(self.arguments or ()),
            'seed': self.seed,
            'options': options,
        }

    @property
    def is_trained(self) -> bool:
        """True where its record holds final scores."""
        return bool(read_record(self.folder)['final'])

    @property
    def is_finished(self) -> bool:
        """True where it is trained and every test is recorded."""
        return self.is_trained and all((self.folder / name / 'test_metrics.json').is_file() for name in self.tests)


def run_folder(out: Path, row: Row, seed: int) -> Path:
    """Work directory of a row and seed: ``CONFIG[_KEY-VALUE...]_seedN``."""
    further = [argument for argument in row.train or () if argument not in DEMO]
    return out / f'{Path(row.config).stem}{_slug(option_texts(row.options), further)}_seed{seed}'


def final_scores(out: Path, row: Row, seed: int) -> dict[str, float]:
    """Scores of a finished row and seed: of its test, or of the last validation of its training."""
    folder = run_folder(out, row, seed)
    if row.test is None:
        scores: dict[str, float] = read_record(folder)['final']
    else:
        scores = read_json(folder / _test_folder(row.test) / 'test_metrics.json')
    return scores


def seeds_of(row: Row, request: Request) -> Sequence[int]:
    """Seeds of a row: its own, or those asked for."""
    return request.seeds if row.seeds is None else row.seeds


def plan(rows: Sequence[Row], request: Request) -> list[Run]:
    """The runs of some rows, each once: rows that train the same share them."""
    runs: dict[Path, Run] = {}
    for row in rows:
        tests = {} if row.test is None else {_test_folder(row.test): option_texts(row.test)}
        options = {**option_texts(row.options), **split_options(request.options)}
        for seed in seeds_of(row, request):
            folder = run_folder(request.out, row, seed)
            shared = runs.get(folder)
            arguments = shared.arguments if shared and row.train is None else row.train
            known = shared.tests if shared else {}
            runs[folder] = Run(row.config, arguments, options, seed, folder, {**known, **tests})
    return list(runs.values())


def run_rows(rows: Sequence[Row], request: Request, commands: Commands | None = None) -> None:
    """Train and test what is not finished.

    Args:
        rows: Of a table.
        request: Folder, seeds, options and how many runs at a time.
        commands: What trains and tests.

    Raises:
        ConfigError: A run was made with other options, is to be tested but never trained, or does not know an option,
            before anything starts; or some runs failed, after all others ended: their logs are named.
    """
    runs = plan(rows, request)
    for run in runs:
        _check(run)
    if commands is None:
        _check_options([run for run in runs if not run.is_finished])
    todo = sum((not run.is_trained) + bool(run.tests and not run.is_finished) for run in runs)
    _Runner(request, commands or Commands(), todo).run_all(runs)


def _check(run: Run) -> None:
    """Refuse a folder that holds another run than the one that is asked for."""
    if run.arguments is None and not run.is_trained:
        raise ConfigError(f'{run.folder}: there is no finished run to test; make the table that trains it first')
    if (run.folder / SPEC).is_file():
        found = read_json(run.folder / SPEC)
    elif run.is_trained:  # by hand, or before specs were kept
        record = read_record(run.folder)
        found = {'config': record.get('config', run.spec['config']), 'seed': record.get('seed', run.seed)}
    else:
        return
    asked = run.spec if run.arguments is not None else {**run.spec, 'arguments': found.get('arguments')}
    different = [f'{key} {found[key]!r}, not {asked.get(key)!r}' for key in found if found[key] != asked.get(key)]
    if different:
        raise ConfigError(f'{run.folder}: was made with {"; ".join(different)}; name another --out, or delete it')


def _check_options(runs: Sequence[Run]) -> None:
    """Resolve the configs of runs as their commands will; seeds apart, each once."""
    seen = set()
    for run in runs:
        tests: list[Mapping[str, str]] = [{**run.options, **test} for test in run.tests.values()]
        for options in [*([run.options] if run.arguments is not None else []), *tests]:
            asked = (run.config, run.arguments or (), tuple(sorted(options.items())))
            if asked not in seen:
                seen.add(asked)
                _resolve(run, options)


def _resolve(run: Run, options: Mapping[str, str]) -> None:
    try:
        load_config(run.config, run.folder, '--demo' in (run.arguments or ()), parse_options(options))
    except ConfigError as error:
        raise ConfigError(f'{run.folder}: {error}; nothing was begun') from error


class _Runner:
    """Several runs at a time, their progress, and what failed."""

    def __init__(self, request: Request, commands: Commands, todo: int) -> None:
        self._request, self._commands = request, commands
        self._progress, self._start = Progress(todo, request.jobs), WarmStart()
        self._stopped = threading.Event()
        self._failed: list[str] = []

    def run_all(self, runs: Sequence[Run]) -> None:
        """All trainings, then all tests: a test may read scenes that another training made."""
        with self._start, ThreadPoolExecutor(self._request.jobs) as pool:
            try:
                list(pool.map(self._trained, runs))
                list(pool.map(self._tested, [run for run in runs if run.tests]))
            except BaseException:  # Ctrl-C, most likely: what has not begun shall not begin
                self._stopped.set()
                raise
        if self._failed:
            raise ConfigError(f'{len(self._failed)} of {len(runs)} runs failed:\n  ' + '\n  '.join(self._failed))

    def _trained(self, run: Run) -> None:
        with self._held(run) as lock:
            if run.is_finished:
                self._request.log(f'{run.folder}: finished before')
            elif not run.is_trained:
                self._timed(run, partial(self._train, run, lock))

    def _tested(self, run: Run) -> None:
        with self._held(run) as lock:
            if run.is_trained and not run.is_finished:
                self._timed(run, partial(self._test_all, run, lock))

    @contextmanager
    def _held(self, run: Run) -> Iterator[int]:
        run.folder.mkdir(parents=True, exist_ok=True)
        with alone(run.folder, self._request.log, self._stopped) as lock:
            yield lock

    def _timed(self, run: Run, work: Callable[[], None]) -> None:
        """Do a part of a run; a failure is kept for the end."""
        if self._stopped.is_set():
            return
        start, what = time.monotonic(), 'done'
        try:
            work()
        except RunError as error:
            self._failed.append(str(error))
            what = 'failed'
        self._request.log(f'{run.folder}: {what}; {self._progress.after(time.monotonic() - start)}')

    def _test_all(self, run: Run, lock: int) -> None:
        for name, options in run.tests.items():
            if not (run.folder / name / 'test_metrics.json').is_file():
                self._test(run, run.folder / name, options, lock)

    def _train(self, run: Run, lock: int) -> None:
        self._request.log(f'{run.folder}: training')
        for stale in run.folder.glob('test*/'):  # of a network that is no more
            shutil.rmtree(stale)
        write_json(run.folder / SPEC, run.spec)
        command = [*self._commands.train(run.config), *(run.arguments or ()), '--resume', '--work-dir', str(run.folder)]
        self._call(command, {**run.options, 'seed': str(run.seed)}, run.folder / 'train.log', lock)
        if not run.is_trained:
            raise RunError(f'{run.folder}: training ended without final scores; see {run.folder / "train.log"}')

    def _test(self, run: Run, folder: Path, options: Mapping[str, str], lock: int) -> None:
        self._request.log(f'{folder}: testing')
        checkpoint = latest_checkpoint(run.folder)
        if checkpoint is None:
            raise RunError(f'{run.folder}: holds no epoch_*.pth to test; delete the folder and make the table again')
        folder.mkdir(exist_ok=True)
        if not (folder / 'labels').is_symlink():  # metrics on hidden points ask there
            (folder / 'labels').symlink_to(Path('..') / 'labels')
        demo = [argument for argument in run.arguments or () if argument in DEMO]
        command = [*self._commands.test(run.config, str(checkpoint)), *demo, '--work-dir', str(folder)]
        self._call(command, {**run.options, **options, 'seed': str(run.seed)}, folder / 'test.log', lock)

    def _call(self, command: Sequence[str], options: Mapping[str, str], log: Path, lock: int) -> None:
        threads = {'threads': '0' if self._request.jobs == 1 else '1'}
        given = [f'{key}={text}' for key, text in (threads | dict(options)).items()]
        code = self._start.run([*command, '--cfg-options', *given], log, lock)
        if code:
            raise RunError(f'{log.parent}: ended with exit code {code}; see {log}')


class RunError(RuntimeError):
    """One run failed; the message names its log."""


class Progress:
    """How many runs are left, and about how long they take.

    Args:
        todo: Runs to make.
        jobs: Runs at a time.
    """

    def __init__(self, todo: int, jobs: int) -> None:
        self._todo, self._jobs = todo, jobs
        self._seconds: list[float] = []
        self._lock = threading.Lock()

    def after(self, seconds: float) -> str:
        """Count a run that took so long; returns what to tell."""
        with self._lock:
            self._seconds.append(seconds)
            left = max(self._todo - len(self._seconds), 0)
            rest = sum(self._seconds) / len(self._seconds) * left / max(min(self._jobs, left), 1)
            told = f'{len(self._seconds)} of {self._todo} runs, {duration(seconds)}'
        return f'{told}; about {duration(rest)} left' if left else told


def duration(seconds: float) -> str:
    """Hours and minutes, or seconds where it is less than two minutes.

    >>> duration(95), duration(3720)
    ('95 s', '1 h 02 min')
    """
    if seconds < 120:
        return f'{seconds:.0f} s'
    minutes = round(seconds / 60)
    return f'{minutes // 60} h {minutes % 60:02d} min' if minutes >= 60 else f'{minutes} min'


@contextmanager
def alone(folder: Path, log: Callable[[str], None], stopped: threading.Event) -> Iterator[int]:
    """Hold a run's folder: nobody else trains in it meanwhile, not even a training that outlived its table.

    Args:
        folder: Of the run.
        log: Told when there is another one to wait for.
        stopped: Ends the waiting.

    Yields:
        The open lock file. A child process that inherits it holds the folder, too.

    Raises:
        RunError: Stopped while waiting.
    """
    handle = os.open(folder / '.lock', os.O_RDWR | os.O_CREAT, 0o666)
    try:
        if not _lock(handle):
            log(f'{folder}: another process works there; waiting for it')
            while not _lock(handle):
                if stopped.wait(1.0):
                    raise RunError(f'{folder}: stopped')
        yield handle
    finally:
        os.close(handle)


def _lock(handle: int) -> bool:
    if os.name != 'posix':
        return True  # there, two tables in one folder are the user's care
    import fcntl

    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _test_folder(options: Mapping[str, Any]) -> str:
    return f'test{_slug(option_texts(options))}'


def _slug(options: Mapping[str, str], further: Sequence[str] = ()) -> str:
    """Options as a part of a folder's name; long ones by their hash."""
    words = [f'_{key}-{text}' for key, text in sorted(options.items())] + [f'_{word.lstrip("-")}' for word in further]
    slug = re.sub(r'[^\w.-]', '-', ''.join(words))
    return slug if len(slug) <= LONGEST_NAME else f'_{content_key(dict(options), list(further))[:12]}'
