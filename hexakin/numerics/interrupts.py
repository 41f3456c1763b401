"""Interrupts (Ctrl-C) of code that is not Python: CasADi's calls and compiled loops."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType


@contextlib.contextmanager
def interrupts_kept() -> Iterator[list[BaseException]]:
    """At the end of the block, or of the decorated function, raise what the handler of SIGINT raised in it.

    CasADi drops such an exception: where it converts arguments, and where it returns from IPOPT, which stops, as if the
    solution had failed. A compiled loop ends with ``numba_cache.Interrupted`` in its place. Every function that calls
    CasADi, or a compiled loop that can be long, is decorated with this, or has a block of it. Python itself drops the
    exception in destructors and in callbacks of C, which numba's compiler uses. The block's value is the list of the
    exceptions so far. Only the main thread handles signals; in other threads nothing is changed.
    """
    handler = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        yield []
        return
    raised: list[BaseException] = []

    def noted(number: int, frame: FrameType | None) -> None:
        try:
            handler(number, frame)
        except BaseException as error:
            raised.append(error)
            raise

    signal.signal(signal.SIGINT, noted)
    try:
        yield raised
    finally:
        signal.signal(signal.SIGINT, handler)
        if raised:
            raise raised[0]
