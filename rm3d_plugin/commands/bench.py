"""Measure the speed and memory of a part of RM3D."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numba
import torch

from rm3d_plugin.commands.numbers import number, whole
from rm3d_plugin.experiments.benchmarks import (
    annotate_page,
    clicks_to_quality,
    cost_model,
    describe,
    descriptors,
    first_call,
    large_scene,
    octree,
    prepare,
    propagate_clicks,
    propagate_together,
    regions,
    sparse_unet,
    training_step,
)

BENCHMARKS = (
    sparse_unet,
    training_step,
    octree,
    *descriptors.ALL,
    describe,
    *regions.ALL,
    prepare,
    large_scene,
    cost_model,
    first_call,
    propagate_clicks,
    propagate_together,
    clicks_to_quality,
    annotate_page,
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one benchmark, print its numbers and write them as JSON if asked."""
    parser = argparse.ArgumentParser(
        prog='rm3d bench',
        description=__doc__,
        epilog='Programs take turns, medians count. Example: rm3d bench octree --points 1000000 --json out.json',
    )
    commands = parser.add_subparsers(required=True, metavar='BENCHMARK')
    for benchmark in BENCHMARKS:
        command = commands.add_parser(benchmark.NAME, help=benchmark.HELP)
        command.add_argument('--threads', type=whole(), default=1, help='threads of torch and of our kernels')
        command.add_argument('--repeats', type=whole(), default=7, help='timed repeats; the median counts')
        command.add_argument('--json', type=Path, help='file that receives the numbers')
        command.register('type', int, whole(0))  # for all that a benchmark asks
        command.register('type', float, number('a number from 0', least=0.0))
        benchmark.add_arguments(command)
        command.set_defaults(run=benchmark.run)
    args = parser.parse_args(arguments)
    torch.set_num_threads(args.threads)
    numba.config.NUMBA_NUM_THREADS = args.threads
    text = json.dumps(args.run(args), indent=2)
    print(text)
    if args.json is not None:
        args.json.parent.mkdir(parents=True, exist_ok=True)
        args.json.write_text(text + '\n')
