"""Names of many parts in little room."""

from __future__ import annotations

import acausal as ac
from acausal.wording import compact, counted, entry_names, grouped, numbers, shortened
from components import World
from tests.scenes import FourBar, chain


def test_runs_of_numbers_share_an_entry_and_long_lists_end():
    names = [f"legs[{i}].knee" for i in range(4)] + ["world"] + [f"legs[{i}].hip" for i in (0, 2, 3)]
    assert compact(names) == "legs[0...3].knee, world, legs[0].hip, legs[2...3].hip"
    assert compact([f"p{i}" for i in range(9)], most=3) == "p0, p1, p2 and 6 more"
    assert compact([f"a[{i}].c[{k}]" for i in range(3) for k in (3, 4)]) == "a[0...2].c[3...4]"
    assert compact([]) == ""


def test_entries_of_vectors_and_matrices_are_named_column_by_column():
    assert entry_names("q", 1) == ("q",) and entry_names("q", 0) == ()
    assert entry_names("v", 2) == ("v[0]", "v[1]")
    assert entry_names("R", 2, 2) == ("R[0,0]", "R[1,0]", "R[0,1]", "R[1,1]")


def test_numbers_in_words():
    assert [counted(n, "state") for n in (0, 1, 2)] == ["0 states", "1 state", "2 states"]
    assert numbers([0.25], 3) == "0.25"
    assert numbers([0.25, -1, 0], 3) == "(0.25, -1, 0)" and numbers([0.25, -1, 0], 2) == "(0.25, -1, …)"


def test_rows_alike_share_a_line():
    assert grouped([("a", "x"), ("b", "y"), ("c", "x")], width=6) == ["  a, c   x (each of 2)", "  b      y"]
    assert shortened(["1", "2", "3"], 2) == ["1", "2", "  and 1 more"]


def test_stages_of_a_hundred_components_stay_readable():
    """Every table and the report of a chain of a hundred bodies, and of twenty four-bars, fits on a page or two."""
    model = ac.build(chain(100))
    many = ac.System()
    many.world, many.bars = World(), [FourBar() for _ in range(20)]
    for bar in many.bars:
        many.connect(many.world.frame, bar.world.frame)
    other = ac.build(many)
    for m in (model, other):
        mechanics = m.system.mechanics
        for table in (m.report(), str(m.system.flat), str(mechanics.mechanism), str(mechanics.tree), str(m.system)):
            assert len(table.splitlines()) < 75
            assert max(len(line) for line in table.splitlines()) < 260
    report = other.report()
    assert "bars[0...19].c" in report and "(each of 20)" in report
