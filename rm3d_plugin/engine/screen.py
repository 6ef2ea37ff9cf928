"""What a run says on the screen: a line an epoch, the labels, the scores; config and environment go to the log file."""

import logging
import re
from typing import Any

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


class QuietRunner(Runner):
    """mmengine's runner, which writes all to the log file and :func:`belongs_on_screen` to the screen."""

    def build_logger(self, *args: Any, **kwargs: Any) -> MMLogger:
        """The logger of the run."""
        logger = super().build_logger(*args, **kwargs)
        for handler in logger.handlers:
            if not isinstance(handler, logging.FileHandler):
                handler.addFilter(belongs_on_screen)
        return logger
