"""Train RM3D or a compared method by a config."""

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

from rm3d_plugin.commands.config_arguments import add_config_arguments, check_config, config_of


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the arguments and train."""
    parser = argparse.ArgumentParser(prog='rm3d train', description=__doc__)
    add_config_arguments(parser)
    parser.add_argument('--resume', action='store_true', help='go on from the newest checkpoint of the work dir')
    parser.add_argument('--overwrite', action='store_true', help='replace the run that the work dir holds')
    parser.add_argument(
        '--add-clicks',
        action='store_true',
        help='with --resume: go on with clicks that were added to their file; the last round is made again with them',
    )
    parser.add_argument('--amp', action='store_true', help='mixed precision: float16 on a GPU, bfloat16 on a CPU')
    parser.add_argument('--launcher', choices=['none', 'pytorch', 'slurm', 'mpi'], default='none')
    parser.add_argument('--local_rank', '--local-rank', type=int, default=0, help=argparse.SUPPRESS)
    args = parser.parse_args(arguments)
    os.environ.setdefault('LOCAL_RANK', str(args.local_rank))
    work_dir = Path(check_config(args).work_dir)

    from mmengine.dist import is_main_process  # torch takes seconds; a wrong config is told before

    from rm3d_plugin.engine.distributed import joined_processes
    from rm3d_plugin.engine.hooks.run_record_hook import final_records, last_summary, read_record
    from rm3d_plugin.engine.run import DEMO_NOTE, train
    from rm3d_plugin.engine.work_dir import check_folder, choose_checkpoint
    from rm3d_plugin.reporting.scores import final_text

    check_folder(work_dir, '--work-dir')
    if not args.resume:
        choose_checkpoint(work_dir, resume=False, overwrite=args.overwrite)  # before demo data are made
    with joined_processes(args.launcher):
        config = config_of(args)
        work_dir = train(config, args.resume, args.amp, args.launcher, args.overwrite, args.add_clicks)
        main_process = is_main_process()
    if main_process:
        record = read_record(work_dir)
        print(final_text(final_records(record), last_summary(record)))
        print(f'{DEMO_NOTE}\n' * config.is_demo + f'report: {work_dir / "report.html"}')
