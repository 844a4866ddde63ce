"""The changes of a C source that make mutants."""

from __future__ import annotations

from pathlib import Path

from mutants.mutations import first_changes, fresh_changes, held_out_changes

SOURCE = """\
enum colour { RED, GREEN, BLUE };
int paint(int from, int until) {
    if (from < until)
        spray(from, until);
    else
        mu_refuse("nothing to paint");
    colour = GREEN;
    done = 10;
    return from - 1;
}
"""


def test_a_held_out_mutant_has_a_mistake_of_another_kind_than_the_first_ones(tmp_path: Path) -> None:
    (tmp_path / "paint.c").write_text(SOURCE)
    files = (tmp_path / "paint.c",)
    held_out = {it.key for it in held_out_changes(files, ())}
    assert held_out == {
        ("if (from < until)", "if (!(from < until))"),
        ("if (from < until)", "if (from <= until)"),
        ("else", ""),
        ("spray(from, until);", "spray(until, from);"),
        ("int paint(int from, int until) {", "int paint(int until, int from) {"),
        ("done = 10;", "done = 100;"),
        ("return from - 1;", "return from;"),
        ("return from - 1;", "return 1 - from;"),
        ("colour = GREEN;", "colour = BLUE;"),
        ("colour = GREEN; done = 10;", "done = 10; colour = GREEN;"),
    }
    assert not held_out & {it.key for it in first_changes(files)}
    (swapped,) = [it for it in held_out_changes(files, ()) if it.key[1] == "spray(until, from);"]
    assert swapped.applied() == SOURCE.replace("spray(from, until)", "spray(until, from)")
    assert str(swapped) == "paint.c:4: spray(from, until);  ->  spray(until, from);"
    fresh = [it.key for it in fresh_changes(files, ())]
    assert len(set(fresh)) == len(fresh)
    assert set(fresh) == held_out | {it.key for it in first_changes(files)}
