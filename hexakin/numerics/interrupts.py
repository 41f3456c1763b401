"""Interrupts (Ctrl-C) of code that is not Python: CasADi's calls and compiled loops."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any


class _Noting:
    """A handler of SIGINT that calls the ``handler`` before it, and notes what that raises in all open ``blocks``."""

    def __init__(self, handler: Callable[[int, FrameType | None], Any]):
        self.handler = handler
        self.blocks: list[list[BaseException]] = []

    def __call__(self, number: int, frame: FrameType | None) -> None:
        try:
            self.handler(number, frame)
        except BaseException as error:
            for raised in self.blocks:
                raised.append(error)
            raise


@contextlib.contextmanager
def _noting() -> Iterator[_Noting | None]:
    """Handle SIGINT by a ``_Noting`` in the block, unless one does so already; None where signals are not handled."""
    if threading.current_thread() is not threading.main_thread():
        yield None
        return
    handler = signal.getsignal(signal.SIGINT)
    if isinstance(handler, _Noting) or not callable(handler):
        yield handler if isinstance(handler, _Noting) else None
        return
    noting = _Noting(handler)
    signal.signal(signal.SIGINT, noting)
    try:
        yield noting
    finally:
        if signal.getsignal(signal.SIGINT) is noting:  # else the block has set another one, which stays
            signal.signal(signal.SIGINT, handler)


@contextlib.contextmanager
def interrupts_kept() -> Iterator[list[BaseException]]:
    """At the end of the block, or of the decorated function, raise what the handler of SIGINT raised in it.

    CasADi drops such an exception: where it converts arguments, and where it returns from IPOPT, which stops, as if the
    solution had failed. A compiled loop ends with ``numba_cache.Interrupted`` in its place. Every function that calls
    CasADi, or a compiled loop that can be long, is decorated with this, or has a block of it. Python itself drops the
    exception in destructors and in callbacks of C, which numba's compiler uses. The block's value is the list of the
    exceptions so far. Only the main thread handles signals; in other threads nothing is changed.
    """
    with _noting() as noting:
        raised: list[BaseException] = []
        if noting is None:
            yield raised
            return
        noting.blocks.append(raised)
        try:
            yield raised
        finally:
            noting.blocks.pop()
            if raised:
                raise raised[0]


@contextlib.contextmanager
def many_interrupts_kept() -> Iterator[None]:
    """Make the blocks of ``interrupts_kept`` inside this block cheap; it raises nothing itself.

    To change the handler of SIGINT takes 10 microseconds. Inside this block it is changed once.
    """
    with _noting():
        yield
