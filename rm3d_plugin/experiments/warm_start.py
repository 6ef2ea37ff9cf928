"""Commands without their start: one process imports the package and forks for each command that it is sent.

A training of a small table takes seconds, and Python's imports take as many. What the forked process does is what a new
one does; elsewhere than on Linux, where forks of loaded libraries may break, commands are started as usual.
"""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Self

from rm3d_plugin.experiments.run_commands import RM3D

IMPORTED = ('rm3d_plugin', 'rm3d_plugin.engine.run', 'rm3d_plugin.commands.train', 'rm3d_plugin.reporting.report_hook')
SERVER = (
    'import socket, sys; from rm3d_plugin.experiments.warm_start import serve; '
    'sys.exit(serve(socket.socket(fileno=int(sys.argv[1]))))'
)
LONGEST = 1 << 20  # bytes of a message
KILLED = -signal.SIGTERM  # where a process ended without a word


class WarmStart:
    """Starts commands; the process that forks them begins with the first and ends with the block."""

    def __init__(self) -> None:
        self._channel: socket.socket | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        if self._channel is not None and self._process is not None:
            self._channel.close()
            self._process.wait()

    def run(self, command: Sequence[str], log: Path, lock: int) -> int:
        """Run a command to its end; returns its exit code, negative where a signal ended it.

        Args:
            command: With its program; ``rm3d`` itself is forked, others are started.
            log: File that takes what it prints.
            lock: Open file that the command holds as long as it runs, even if this process ends before.
        """
        with log.open('w', encoding='utf-8') as stream:
            if sys.platform == 'linux' and tuple(command[: len(RM3D)]) == RM3D:
                return self._fork(command[len(RM3D) :], stream.fileno(), lock)
            files = (lock,) if os.name == 'posix' else ()
            return subprocess.run(command, stdout=stream, stderr=subprocess.STDOUT, pass_fds=files).returncode

    def _fork(self, arguments: Sequence[str], log: int, lock: int) -> int:
        answer, theirs = os.pipe()
        with os.fdopen(answer) as told:
            try:
                with self._lock:
                    self._send([f'{json.dumps(list(arguments))}\n'.encode()], [log, lock, theirs])
            finally:
                os.close(theirs)
            return int(told.read() or KILLED)

    def _send(self, message: Sequence[bytes], files: Sequence[int]) -> None:
        channel = self._started()
        with suppress(ConnectionError):  # it could not import, and said why; nobody will answer
            socket.send_fds(channel, message, files)
            channel.recv(1)  # it has the files

    def _started(self) -> socket.socket:
        if self._channel is None:
            self._channel, theirs = socket.socketpair()
            command = [sys.executable, '-c', SERVER, str(theirs.fileno())]
            self._process = subprocess.Popen(command, pass_fds=(theirs.fileno(),), stdin=subprocess.DEVNULL)
            theirs.close()
        return self._channel


def serve(channel: socket.socket) -> int:
    """Fork for each command until the other end closes; returns the exit code, in the forked process the command's."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for those that answer
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # commands heed it; this ends with the table
    for name in IMPORTED:
        import_module(name)
    while (message := _receive(channel)) is not None:
        arguments, files = message
        if os.fork() == 0:
            channel.close()
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            return _command(arguments, *files)
        for file in files:
            os.close(file)
        channel.send(b'.')
    return 0


def _receive(channel: socket.socket) -> tuple[list[str], list[int]] | None:
    """Arguments and files of the next command; None where there is none."""
    text, files = b'', list[int]()
    while not text.endswith(b'\n'):
        part, more, _, _ = socket.recv_fds(channel, LONGEST, 3)
        if not part:
            return None
        text, files = text + part, files + more
    return json.loads(text), files


def _command(arguments: Sequence[str], log: int, lock: int, answer: int) -> int:
    """In a process of its own that tells how the command ended; the command's own process returns its exit code."""
    if worker := os.fork():
        code = os.waitstatus_to_exitcode(os.waitpid(worker, 0)[1])
        os.write(answer, str(code).encode())
        os._exit(0)
    os.close(answer)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.dup2(log, sys.stdout.fileno())
    os.dup2(log, sys.stderr.fileno())
    main = import_module('rm3d_plugin.commands.main').main
    result: int = main(arguments)
    return result
