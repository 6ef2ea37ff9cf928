"""Benchmarks behind ``rm3d bench``: one module a command, each with NAME, HELP, add_arguments and run."""
