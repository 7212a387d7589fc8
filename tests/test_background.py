"""What goes on beside a run: compilers in the background, the line that says how far it is, Ctrl-C."""

from __future__ import annotations

import io
import logging
import os
import subprocess
import sys
import time
from pathlib import Path

import casadi as ca
import pytest

import acausal as ac
from acausal.errors import ExportError
from acausal.runtime.kernels import Compilation, How, Kernels, Wanted
from acausal.runtime.load import runtime
from acausal.simulate.progress import Line, duration, shown_progress
from tests.scenes import DoublePendulum

ENDS_EARLY = """
import sys, time
from pathlib import Path
import casadi as ca
from acausal.runtime.kernels import Compilation, Wanted
x = ca.SX.sym("x")
Compilation((Wanted("f", ca.Function("f", [x], [ca.sin(x)])),), (sys.argv[1],)).begin()
while not Path(sys.argv[2]).exists():
    time.sleep(0.01)
"""

INTERRUPTED = """
import os, signal, threading
import numpy as np
from tests.scenes import DoublePendulum
import acausal as ac
signal.signal(signal.SIGINT, signal.default_int_handler)  # also where whoever started the tests ignores it
scene = DoublePendulum()
model = ac.build(scene)
for compiled in (True, False):
    model.simulate(0.1, compiled=compiled)
    threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
    try:
        model.simulate(1e6, {scene.shoulder.q: 2.0}, compiled=compiled, method="gauss")
    except KeyboardInterrupt as interrupt:
        run = interrupt.run
        print(0 < run.t[-1] < 1e6 and np.isfinite(run[scene.lower.tip.position]).all() and run.energy_error() < 1e-6)
"""


def _run(script: str, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    root = Path(ac.__file__).parents[1]
    variables = os.environ | {"PYTHONPATH": str(root)} | environment
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", script, *arguments],
        capture_output=True,
        text=True,
        env=variables,
        cwd=root,
        timeout=60,
        check=False,
    )


def test_process_that_ends_takes_its_compilers_along_and_leaves_no_files(tmp_path: Path) -> None:
    slow, begun, cache = tmp_path / "cc", tmp_path / "begun", tmp_path / "cache"
    slow.write_text(f"#!/bin/sh\nsleep 60 &\necho $! > {begun}.part\nmv {begun}.part {begun}\nwait\n")
    slow.chmod(0o755)
    ended = _run(ENDS_EARLY, str(slow), str(begun), ACAUSAL_CACHE=str(cache))
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")
    assert not list(cache.iterdir())
    helper, end = int(begun.read_text()), time.monotonic() + 5
    while _alive(helper) and time.monotonic() < end:
        time.sleep(0.01)
    assert not _alive(helper)


def _alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_interrupt_by_the_user_keeps_what_was_computed() -> None:
    ended = _run(INTERRUPTED)
    assert (ended.returncode, ended.stderr, ended.stdout.split()) == (0, "", ["True", "True"])


def test_what_casadi_is_stopped_by_is_passed_on(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = DoublePendulum()
    model = ac.build(scene)
    problem = model.functions.native(How.CASADI)
    assert problem is not None
    monkeypatch.setattr(type(model.functions), "native", lambda *_: problem)
    problem.kernels.stopped.append(KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt) as caught:
        model.simulate(1.0, {scene.shoulder.q: 2.0}, compiled=False)
    assert caught.value.run.t[-1] <= 1.0  # type: ignore[attr-defined]


def test_one_line_says_that_something_is_compiled(caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]) -> None:
    library, x = runtime(), ca.SX.sym("x")
    assert library is not None
    kernels = Kernels([Wanted("f", ca.Function("f", [x], [ca.sin(x) + time.time_ns() % 1_000_003]))], library, How.AUTO)
    began = time.perf_counter()
    assert kernels.kind == "interpreted" and not kernels.busy and kernels.compiled_between(0.0, began) == 0.0
    with caplog.at_level(logging.INFO, logger="acausal"):
        kernels.spent(1e6)
        assert kernels.compiled_between(began, time.perf_counter()) > 0.0
        end = time.monotonic() + 60
        while not kernels.version and time.monotonic() < end:
            time.sleep(0.01)
            kernels.spent(0.0)
    assert kernels.kind == "compiled" and not kernels.busy
    assert [record.getMessage() for record in caplog.records] == [
        "acausal compiles kernels in the background (f); the run goes on meanwhile."
    ]
    now = time.perf_counter()
    assert 0.0 < kernels.compiled_between(began, now) < now - began
    assert kernels.compiled_between(now, now + 1.0) == 0.0
    assert capfd.readouterr() == ("", "")


def test_statistics_tell_kernels_and_their_making_apart_from_the_run() -> None:
    scene = DoublePendulum()
    model = ac.build(scene)
    first, second = (model.simulate(0.1, {scene.shoulder.q: 2.0}).statistics for _ in range(2))
    assert first.compiling > 0.0 and second.compiling == 0.0
    assert first.kernels.startswith(("interpreted", "compiled"))
    assert model.simulate(0.1, compiled=False).statistics.kernels == "CasADi's"
    native = model.functions.native(How.INTERPRETED)
    assert native is not None and native.kernels.kind == "interpreted"


class Terminal(io.StringIO):
    """Of a person who looks at it."""

    def isatty(self) -> bool:
        return True


def test_progress_is_one_line_with_the_time_left_that_disappears(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    line = shown_progress(True, lambda: True)
    assert isinstance(line, Line)
    line.begun -= 30.0
    line(0.25)
    assert terminal.getvalue() == "\r 25.0 %, 30 s, 90 s left; a compiler works in the background"
    line.close()
    assert terminal.getvalue().endswith("\r" + " " * 60 + "\r") and "\n" not in terminal.getvalue()
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    assert shown_progress(True, lambda: True) is None  # a pipe, or a test
    assert [duration(s) for s in (0.04, 12.3, 200.0, 7500.0)] == ["0.0 s", "12 s", "3 min 20 s", "2 h 5 min"]


def test_failing_compiler_is_said_and_the_interpreter_goes_on(caplog: pytest.LogCaptureFixture, tmp_path: Path) -> None:
    x, broken = ca.SX.sym("x"), tmp_path / "cc"
    broken.write_text("#!/bin/sh\necho it is broken >&2\nexit 1\n")
    broken.chmod(0o755)
    compilation = Compilation((Wanted("f", ca.Function("f", [x], [x])),), (str(broken),))
    with caplog.at_level(logging.INFO, logger="acausal"):
        compilation.begin()
        end = time.monotonic() + 30
        while compilation.busy and time.monotonic() < end:
            time.sleep(0.01)
    assert not compilation.succeeded and "it is broken" in caplog.text
    with pytest.raises(ExportError, match="it is broken"):
        compilation.result()
