"""Whole trainings on a world of three streets, each in a process of its own, some killed at a chosen moment.

The processes are forked from a server that has imported everything once, so one costs little more than its work;
where there is a GPU, which no forked process could use, each imports everything by itself.
"""

import io
import multiprocessing
import os
import re
import runpy
import signal
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import torch

ROOT = Path(__file__).resolve().parents[2]
CONFIG = ROOT / 'configs' / 'rm3d_votenet_kitti_1pct.py'
SIZES = {
    'widths': [8, 16],
    'hidden': 16,
    'voxel_size': 0.3,
    'model.vote_head.num_seeds': 64,
    'model.vote_head.num_proposals': 16,
    'sigma': 1,
    'rounds': 2,
    'warm_up_rounds': 1,
    'final_rounds': 1,
    'val_rounds': 1,
    'milestones': [1],
    'batch_size': 1,
    'threads': 1,
    'descriptor': {'type': 'AdaptedPFH', 'radius': 0.8, 'max_neighbors': 16},
}
# Added to SIZES: a run that learns three streets by heart in a few seconds.
LEARNT = {
    'rounds': 1,
    'sigma': 30,
    'budget': 'full',
    'param_scheduler': '${step_schedule}',
    'milestones': [26],
    'learning_rate': 0.01,
    'paste_objects': 1,
    'score_by_points': False,  # thirty epochs teach it boxes, hardly classes of points
}
_CONTEXT = multiprocessing.get_context('spawn' if torch.cuda.is_available() else 'forkserver')
_PRELOAD = ('rm3d_plugin.engine.run', 'rm3d_plugin.models', 'rm3d_plugin.evaluation', 'matplotlib.backends.backend_agg')
_CONTEXT.set_forkserver_preload([*_PRELOAD, 'torch._inductor', 'runs.tiny_runs'])


def make_world(folder: Path) -> Path:
    """Three training streets and one to validate on, seen by a coarse lidar."""
    from rm3d_plugin.datasets.synthetic import make_streets

    make_streets(folder, num_train=3, num_val=1, seed=1, azimuth_step=1.0)
    return folder


def options(world: Path, **more: Any) -> dict[str, Any]:
    """What makes the demo config tiny; double underscores in names stand for dots."""
    own = {'data_root': str(world), 'cache_dir': str(world.parent / 'geometry')}
    return SIZES | own | {key.replace('__', '.'): value for key, value in more.items()}


def arguments_of(settings: dict, work_dir: Path) -> list[str]:
    """A command line of the tiny config."""
    pairs = [f'{key}={value}' for key, value in flat(settings).items()]
    return [str(CONFIG), '--work-dir', str(work_dir), '--cfg-options', *pairs]


def flat(settings: dict) -> dict:
    """Nested settings as dotted keys with values as the command line takes them."""
    out = {}
    for key, value in settings.items():
        if isinstance(value, dict):
            out |= {f'{key}.{inner}': item for inner, item in value.items()}
        else:
            out[key] = str(value).replace(' ', '')
    return out


def run(log: Path, task: Callable[..., None], *args: Any) -> tuple[int, str]:
    """Call a module-level function in a fresh process; its exit status (negative: a signal) and all that it wrote."""
    return begin(log, task, *args).end()


class Started(NamedTuple):
    """A process that runs, and where it writes."""

    process: Any
    log: Path

    def end(self, kill_after: float | None = None) -> tuple[int, str]:
        """Wait for it, or kill it after so many seconds; see :func:`run`."""
        self.process.join(600 if kill_after is None else kill_after)  # s on a busy machine; a run takes a few alone
        if kill_after is not None and self.process.exitcode is None:
            os.kill(self.process.pid, signal.SIGKILL)
            self.process.join()
        assert self.process.exitcode is not None, f'{self.log} did not end in 600 s'
        return self.process.exitcode, self.log.read_text()


def begin(log: Path, task: Callable[..., None], *args: Any) -> Started:
    """Call a module-level function in a fresh process; see :func:`run`."""
    log.touch()
    process = _CONTEXT.Process(target=_logged, args=(log, task, args))
    process.start()
    return Started(process, log)


def _logged(log: Path, task: Callable[..., None], args: tuple[Any, ...]) -> None:
    with log.open('w') as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    sys.stdout = sys.stderr = open(1, 'w', buffering=1, closefd=False)  # noqa: SIM115  lives as long as the process
    code: Any = 0
    try:
        task(*args)
    except SystemExit as end:
        code = end.code or 0
    except BaseException:
        traceback.print_exc()
        code = 1
    sys.stdout.flush()
    os._exit(code)


def command(tool: str, cwd: Path, arguments: list[str]) -> None:
    """``python tools/TOOL.py ARGUMENTS`` in a folder."""
    os.chdir(cwd)
    sys.path.insert(0, str(ROOT / 'tools'))
    sys.argv = [f'tools/{tool}.py', *arguments]
    _skip_pretty_printing()
    runpy.run_path(str(ROOT / 'tools' / f'{tool}.py'), run_name='__main__')


def _skip_pretty_printing() -> None:
    """Laying out the config's text costs more than training on three streets."""
    import mmengine.config.config as config

    config.FormatCode = lambda text, **_: (text, True)


def train(
    work_dir: Path,
    settings: dict[str, Any],
    resume: bool = False,
    moment: str | None = None,
    pictures: bool = False,
    change: Callable[[Any], None] | None = None,
    overwrite: bool = False,
) -> None:
    """Train by the tiny config and tell each refresh.

    Args:
        work_dir: Of the run.
        settings: Options of the config.
        resume: Go on with what is there.
        moment: Kill this process then.
        pictures: Draw those of the report.
        change: Called with the config before anything is built.
        overwrite: Replace the run that is there.
    """
    from mmengine.registry import init_default_scope

    from rm3d_plugin.engine.config import load_config
    from rm3d_plugin.engine.run import set_threads
    from rm3d_plugin.engine.run import train as train_config
    from rm3d_plugin.registry import SCOPE

    config = load_config(CONFIG, work_dir, demo=True, options=settings)
    set_threads(config.threads)
    init_default_scope(SCOPE)
    _skip_pretty_printing()
    _tell_refreshes()
    if moment is not None:
        MOMENTS[moment]()
    if not pictures:
        next(hook for hook in config.custom_hooks if hook.type == 'ReportHook').update(train_scenes=0, val_scenes=0)
    if change is not None:
        change(config)
    train_config(config, resume, overwrite=overwrite)


def _tell_refreshes() -> None:
    from rm3d_plugin.labeling.detection import DetectionLabelMaker

    refresh = DetectionLabelMaker.refresh

    def told(self: Any, number: int, scene_id: str, prediction: Any) -> None:
        how = 'geometry' if prediction is None else 'network'
        sys.stdout.flush()
        os.write(1, f'refresh of round {number}, scene {scene_id}, by {how}\n'.encode())  # whole, whoever else writes
        refresh(self, number, scene_id, prediction)

    DetectionLabelMaker.refresh = told


def refreshes(log: str) -> list[tuple[int, str, str]]:
    """(round, scene, by what) of each refresh that a log tells."""
    found = re.findall(r'refresh of round (\d+), scene (\w+), by (\w+)', log)
    return [(int(number), scene, how) for number, scene, how in found]


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def _kill_at_call(owner: Any, name: str, call: int, after: bool) -> None:
    """Replace ``owner.name`` by itself with a death before or after its ``call``-th call (from 1)."""
    original, calls = getattr(owner, name), iter(range(1, 10**6))

    def wrapped(*args: Any, **kwargs: Any) -> Any:
        last = next(calls) == call
        if last and not after:
            die()
        result = original(*args, **kwargs)
        if last:
            die()
        return result

    setattr(owner, name, wrapped)


def _in_first_epoch() -> None:
    from rm3d_plugin.engine.loops import RoundTrainLoop

    _kill_at_call(RoundTrainLoop, 'run_iter', call=2, after=True)


def _in_second_epoch() -> None:
    from rm3d_plugin.engine.loops import RoundTrainLoop

    _kill_at_call(RoundTrainLoop, 'run_iter', call=5, after=True)  # three scenes, three iterations an epoch


def _in_refresh() -> None:
    from rm3d_plugin.labeling.detection import DetectionLabelMaker

    _kill_at_call(DetectionLabelMaker, 'refresh', call=5, after=True)  # two of three scenes have labels of round 1


def _before_round_closes() -> None:
    from rm3d_plugin.labeling.detection import DetectionLabelMaker

    _kill_at_call(DetectionLabelMaker, 'finish', call=2, after=False)


def _before_validation() -> None:
    from mmengine.runner import ValLoop

    _kill_at_call(ValLoop, 'run', call=1, after=False)


def _before_last_validation() -> None:
    from mmengine.runner import ValLoop

    _kill_at_call(ValLoop, 'run', call=2, after=False)


def _in_checkpoint() -> None:
    """Half of the second checkpoint reaches the disk."""
    from rm3d_plugin.storage import files

    write, calls = files.atomic_write, iter(range(1, 10**6))

    def half(path: Any, content: Any) -> Any:
        if str(path).endswith('.pth') and next(calls) == 2:
            content = _dying_after_half(content)
        return write(path, content)

    files.atomic_write = half


def _dying_after_half(content: Any) -> Any:
    def write(file: Any) -> None:
        whole = io.BytesIO()
        content(whole)
        file.write(whole.getvalue()[: len(whole.getvalue()) // 2])
        file.flush()
        die()

    return write


def _before_rename(call: int, part: str) -> None:
    """Die when a written file shall take its place: the ``call``-th whose path holds ``part``."""
    replace, calls = os.replace, iter(range(1, 10**6))

    def dying(source: Any, target: Any, **kwargs: Any) -> None:
        if part in str(target) and next(calls) == call:
            die()
        replace(source, target, **kwargs)

    os.replace = dying


def _in_a_label_file() -> None:
    _before_rename(2, 'labels/round_001/')


def _in_the_record() -> None:
    _before_rename(3, 'run/metrics.json')  # losses, scores, losses


MOMENTS = {
    'in a label file': _in_a_label_file,
    'in the record': _in_the_record,
    'in the first epoch': _in_first_epoch,
    'in the second epoch': _in_second_epoch,
    'in a refresh': _in_refresh,
    'before a round closes': _before_round_closes,
    'in a checkpoint': _in_checkpoint,
    'before a validation': _before_validation,
    'before the last validation': _before_last_validation,
}
