"""The conformance kit: its words, its judge with boards that differ in one thing, and its shortening of scripts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from firmware_model.bench import Bench
from firmware_model.bench.conformance import (
    Case,
    Source,
    Verdict,
    history,
    judged,
    random_cases,
    shrunk,
    side_by_side,
)
from firmware_model.bench.conformance_cases import CASES
from firmware_model.config import BoardConfig
from firmware_model.table_one import worst_case_board

DIVE = Case(
    "dive", Source.PAPER, "it rises and sinks", "3s permission 70s rises 1h falls 1s release 5min", 0.4
)


class Died(Exception):
    """The firmware of a test's board."""


def board(config: BoardConfig) -> Callable[[float], Bench]:
    return lambda primary: Bench(config, primary=primary)


OURS = board(worst_case_board())


def test_the_cases_are_sixty_and_more_with_a_name_each() -> None:
    assert len(CASES) >= 60
    assert len({case.name for case in CASES}) == len(CASES)
    assert {case.source for case in CASES} == set(Source)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_each_case_can_be_played_and_ours_passes(case: Case) -> None:
    assert judged(case, OURS, OURS, Died, {}).verdict is Verdict.PASSED


def test_a_history_has_motors_and_charges_at_their_times() -> None:
    """By hand: up at 3 s, docked at 73 s and charging 50 ms later, released an hour later, and down on the release."""
    events = [str(event) for event in history(DIVE, OURS, Died).events]
    assert events == [
        "3.000 s motors float",
        "73.050 s charges",
        "3673.050 s stops charging",
        "3674.000 s motors sink",
    ]


DIFFERENT = {
    "a slower debounce": (replace(worst_case_board(), pin_debounce_ms=80), "expected 73.050 s charges"),
    "no wait for the release": (
        replace(worst_case_board(), release_wait_ms=100),
        "expected 3674.000 s motors sink",
    ),
}


@pytest.mark.parametrize("name", DIFFERENT)
def test_another_time_fails_and_is_told(name: str) -> None:
    config, reason = DIFFERENT[name]
    result = judged(DIVE, OURS, board(config), Died, {})
    assert result.verdict is Verdict.FAILED
    assert result.reason.startswith(reason)
    assert any(line.startswith(" !") for line in side_by_side(result))


def test_another_load_fails_by_its_energy_alone() -> None:
    """0.3 % of what flowed is the bound: here 0.2 % passes, and 0.6 % does not."""
    hour = Case("hours", Source.PAPER, "it draws its load", "8h")
    for permille, verdict in ((1002, Verdict.PASSED), (1006, Verdict.FAILED)):
        charge = worst_case_board().charge
        drains = replace(charge, discharge=charge.discharge * permille // 1000)
        config = replace(worst_case_board(), charge=drains)
        assert judged(hour, OURS, board(config), Died, {}).verdict is verdict


def test_our_own_choice_differs_and_a_waived_case_names_its_reason() -> None:
    slower = board(DIFFERENT["a slower debounce"][0])
    choice = replace(DIVE, source=Source.CHOICE)
    assert judged(choice, OURS, slower, Died, {}).verdict is Verdict.DIFFERS
    waived = judged(DIVE, OURS, slower, Died, {"dive": "our contact is slow"})
    assert waived.verdict is Verdict.WAIVED
    assert waived.reason.startswith("our contact is slow (expected 73.050 s")


def test_dead_firmware_fails_whatever_the_source() -> None:
    def dies(primary: float) -> Bench:
        bench = Bench(worst_case_board(), primary=primary)

        def run(**spans: float) -> None:
            raise Died("it ended")

        bench.run = run  # type: ignore[method-assign, assignment]
        return bench

    result = judged(replace(DIVE, source=Source.CHOICE), OURS, dies, Died, {})
    assert (result.verdict, result.reason) == (Verdict.FAILED, "its firmware failed: it ended")


def test_a_script_loses_every_word_that_it_does_not_need() -> None:
    def differs(case: Case) -> bool:
        words = case.script.split()
        return "rises" in words and "falls" in words[words.index("rises") :]

    long = replace(DIVE, script="3s permission 2min rises 1h ping falls 5min release")
    assert shrunk(long, differs).script == "rises falls"


def test_random_scripts_are_the_same_for_a_seed() -> None:
    assert list(random_cases(20, 1)) == list(random_cases(20, 1))
    assert {case.script for case in random_cases(20, 1)}.isdisjoint(
        case.script for case in random_cases(20, 2)
    )


def test_an_unknown_word_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match="'jump' is neither a wait nor one of permission"):
        history(replace(DIVE, script="3s jump"), OURS, Died)
