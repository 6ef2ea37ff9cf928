"""Benchmarks behind ``tools/bench.py``: one module a command, each with NAME, HELP, add_arguments and run."""
