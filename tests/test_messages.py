"""Messages and progress never end a calculation, whatever stderr is."""

import io
import os
import sys

import pytest

import hexakin as hk
from hexakin.numerics.cache_folders import tell_once
from hexakin.numerics.messages import messages
from hexakin.study import Study, grid, run


def closed():
    stream = io.StringIO()
    stream.close()
    return stream


def broken_pipe():
    reading, writing = os.pipe()
    os.close(reading)
    return os.fdopen(writing, "w", buffering=1)


def full():
    if not os.path.exists("/dev/full"):
        pytest.skip("no device is always full")
    return open("/dev/full", "w", buffering=1)


def trial(index):
    return {"twice": 2 * index}


@pytest.mark.parametrize("stream", [lambda: None, closed, broken_pipe, full])
def test_work_goes_on_where_stderr_takes_nothing(athena, tmp_path, monkeypatch, stream):
    made = stream()
    monkeypatch.setattr(sys, "stderr", made)
    controller, options = hk.PostureController(athena), {"engine": "rigid", "time_step": 0.01, "settling_time": 0.1}
    walk = hk.simulate(athena, hk.terrain.Plane(), controller, duration=0.2, progress=True, **options)
    table = run(Study("mine", trial, grid(index=range(3))), tmp_path, jobs=1)
    tell_once(f"said to {stream.__name__}")
    monkeypatch.undo()
    if made is not None and not made.closed:
        with pytest.raises(OSError):  # what the buffer still has
            made.close()
    assert len(walk.time) == 4 and list(table["twice"]) == [0, 2, 4]


def test_characters_that_stderr_cannot_encode_are_escaped(monkeypatch):
    taken = io.BytesIO()
    monkeypatch.setattr(sys, "stderr", io.TextIOWrapper(taken, encoding="ascii", errors="strict", newline="\n"))
    print("Käfer k_β", file=messages, flush=True)
    assert taken.getvalue() == b"K\\xe4fer k_\\u03b2\n" and messages.encoding == "ascii" and not messages.isatty()
    with pytest.raises(OSError):
        messages.fileno()
