"""The cost of a status request follows from the board that answers it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from apad_bridge.assembly.water import answer_charge, wrong_plan_charge
from firmware_model.bench import Bench
from firmware_model.packets import Kind
from firmware_model.power.charge import FULL
from firmware_model.power.rails import Rail, bits
from firmware_model.table_one import HOURLY, board, power


@pytest.mark.parametrize("kept_on", [0, bits(Rail.PI), bits(Rail.MU_ACTIVE)])
@pytest.mark.parametrize(("turnaround_ms", "answer_ms"), [(500, 393), (2000, 1830)])
def test_an_answer_costs_what_a_board_spends_on_it(kept_on: int, turnaround_ms: int, answer_ms: int) -> None:
    made = board(HOURLY, power(kept_on=kept_on))
    made = replace(made, whole=replace(made.whole, turnaround_ms=turnaround_ms, answer_ms=answer_ms))
    queried, other = (Bench(made) for _ in range(2))
    for bench in (queried, other):
        bench.run(minutes=30)
    queried.command(Kind.PING)
    for bench in (queried, other):
        bench.run(minutes=1)
    assert made.whole is not None
    assert answer_charge(made.whole) * FULL == pytest.approx(other.primary - queried.primary, rel=1e-12)


def test_a_needless_way_up_and_down_is_two_runs_of_the_motors() -> None:
    """Table I's fit gives 0.0268 a run."""
    whole = board(HOURLY, power()).whole
    assert whole is not None and wrong_plan_charge(whole) == pytest.approx(2 * 0.0268, rel=1e-6)
