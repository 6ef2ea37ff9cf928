"""What a run says on the screen: a line an epoch, the labels, the scores; config and environment go to the log file."""

import logging
import re
import time
from typing import Any, ClassVar

from mmengine.logging import MMLogger
from mmengine.runner import Runner

LEFT_OUT = (
    'Config:',
    '-' * 20,  # the environment
    'Hooks will be executed',
    'Exp name:',
    'Checkpoints will be saved to',
    'Distributed training is not used',
    'The prefix is not set in metric class',
    '"FileClient" will be deprecated',
    '"HardDiskBackend" is the alias',
)
"""Beginnings of messages that are of use in the log file only."""
STEP = re.compile(r'\s*Epoch\((train|val|test)\).*?\[\s*(\d+)/(\d+)\]')


def belongs_on_screen(record: logging.LogRecord) -> bool:
    """Whether a message is shown: of the steps of an epoch the last, and nothing of :data:`LEFT_OUT`."""
    text = re.sub(r'\x1b\[[0-9;]*m', '', record.getMessage()).lstrip()
    step = STEP.match(text)
    return step[2] == step[3] if step else not text.startswith(LEFT_OUT)


MOMENT = '%Y%m%d_%H%M%S'  # as mmengine names runs


class QuietRunner(Runner):
    """mmengine's runner, which writes all to the log file and :func:`belongs_on_screen` to the screen."""

    _latest: ClassVar[float] = 0.0  # seconds, when a run of this process began

    def setup_env(self, env_cfg: dict[str, Any]) -> None:
        """Name the run by when it began, a second after the one before at least: runs of one name share a log."""
        super().setup_env(env_cfg)
        began = time.mktime(time.strptime(self.timestamp, MOMENT))
        QuietRunner._latest = max(began, QuietRunner._latest + 1)
        self._timestamp = time.strftime(MOMENT, time.localtime(QuietRunner._latest))

    def build_logger(self, *args: Any, **kwargs: Any) -> MMLogger:
        """The logger of the run."""
        logger = super().build_logger(*args, **kwargs)
        for handler in logger.handlers:
            if not isinstance(handler, logging.FileHandler):
                handler.addFilter(belongs_on_screen)
        return logger
