"""What the logger ``imitor`` is told becomes lines on the terminal, without tearing what is drawn there."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Iterator


class _Sayer(logging.Handler):
    def __init__(self, say: Callable[[str], None]) -> None:
        super().__init__()
        self._say = say

    def emit(self, record: logging.LogRecord) -> None:
        self._say(record.getMessage())


@contextlib.contextmanager
def logged(say: Callable[[str], None]) -> Iterator[None]:
    """Say what the logger is told from ``INFO`` on while the context lasts.

    Args:
        say: Prints a line.
    """
    logger, handler = logging.getLogger("imitor"), _Sayer(say)
    level, logger_propagates = logger.level, logger.propagate
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    logger.propagate = False
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        logger.propagate = logger_propagates


__all__ = ["logged"]
