"""Linear algebra on one thread: what is decided by numbers does not depend on how many processors there are."""

from __future__ import annotations

import gc
import threading

import casadi as ca
import pytest

from acausal.numerics import one_thread
from acausal.numerics.one_thread import on_one_thread
from acausal.numerics.uncollected import uncollected
from acausal.runtime.program import program


@pytest.fixture(autouse=True)
def two_threads():
    found = one_thread._threads()
    if found is None:
        yield lambda: 1
        return
    get, change = found
    before = get()
    change(2)
    yield get
    change(before)


def test_within_it_is_one_and_afterwards_what_it_was(two_threads) -> None:
    outside = two_threads()
    with on_one_thread:
        with on_one_thread:
            assert two_threads() == 1
        assert two_threads() == 1
    assert two_threads() == outside


def test_functions_keep_their_names_results_and_errors(two_threads) -> None:
    outside = two_threads()

    @on_one_thread
    def inverse(x: float) -> float:
        """One over x."""
        assert two_threads() == 1
        return 1 / x

    assert (inverse.__name__, inverse.__doc__, inverse(2.0)) == ("inverse", "One over x.", 0.5)
    with pytest.raises(ZeroDivisionError):
        inverse(0.0)
    assert two_threads() == outside


def test_as_long_as_anybody_is_within(two_threads) -> None:
    outside, entered, leave = two_threads(), threading.Event(), threading.Event()

    def other() -> None:
        with on_one_thread:
            entered.set()
            leave.wait(10)

    with on_one_thread:
        thread = threading.Thread(target=other)
        thread.start()
        assert entered.wait(10)
    assert two_threads() == 1
    leave.set()
    thread.join()
    assert two_threads() == outside


def test_garbage_is_collected_again_after_programs_are_made_and_only_where_it_was() -> None:
    x = ca.SX.sym("x")
    for before in (True, False):
        (gc.enable if before else gc.disable)()
        try:
            with uncollected:
                with uncollected:
                    assert not gc.isenabled()
                assert not gc.isenabled()
            assert gc.isenabled() is before
            program(ca.Function("f", [x], [ca.sin(x)]), "f", 4)
            assert gc.isenabled() is before
        finally:
            gc.enable()
