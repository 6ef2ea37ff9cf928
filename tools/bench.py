"""Measure a part of RM3D: ``tools/bench.py sparse-unet --voxels 50000 --backward --threads 1 --json out.json``."""

import argparse
import json
from pathlib import Path

import torch
from benchmarks import sparse_unet

BENCHMARKS = (sparse_unet,)


def main() -> None:
    """Run one benchmark, print its numbers and write them as JSON if asked."""
    parser = argparse.ArgumentParser(description='Benchmarks of RM3D; medians of interleaved repeats.')
    commands = parser.add_subparsers(required=True, metavar='BENCHMARK')
    for benchmark in BENCHMARKS:
        command = commands.add_parser(benchmark.NAME, help=benchmark.HELP)
        benchmark.add_arguments(command)
        command.add_argument('--threads', type=int, default=1, help='threads of torch and of our kernels')
        command.add_argument('--repeats', type=int, default=7, help='timed repeats; the median counts')
        command.add_argument('--json', type=Path, help='file that receives the numbers')
        command.set_defaults(run=benchmark.run)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    text = json.dumps(args.run(args), indent=2)
    print(text)
    if args.json is not None:
        args.json.parent.mkdir(parents=True, exist_ok=True)
        args.json.write_text(text + '\n')


if __name__ == '__main__':
    main()
