"""The conformance kit: its words, its judge with boards that differ in one thing, and its shortening of scripts."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import pytest

from firmware_model.actions import Action, Dropped
from firmware_model.base_firmware import Firmware
from firmware_model.bench import Bench
from firmware_model.bench.conformance import (
    Case,
    CaseReading,
    CaseResult,
    RequirementSource,
    Verdict,
    captured,
    history,
    judged,
    random_cases,
    shrunk,
    side_by_side,
    traced,
    worst_case_of,
)
from firmware_model.bench.conformance_cases import CASES, WAYS_INTO
from firmware_model.bench.costly_firmware import CostlyFirmware
from firmware_model.bench.rigs import BenchRig, Rig, RigEvent, RigHistory, lasts_ms
from firmware_model.bench.whole_conformance_cases import WHOLE_CASES
from firmware_model.config import BoardConfig
from firmware_model.packets import Command, Kind, StatusPacket
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.power.charge_pin import ChargePin, Edge
from firmware_model.states import State, Trigger
from firmware_model.table_one import worst_case_board

DIVE = Case(
    "dive",
    RequirementSource.PAPER,
    "it rises and sinks",
    "3s permission 70s rises 1h falls 1s release 5min",
    0.4,
)


class Died(Exception):
    """The firmware of a test's board."""


def board(config: BoardConfig) -> Callable[[Case], Rig]:
    return lambda case: BenchRig(Bench(replace(config, agent_id=case.agent_id), primary=case.primary))


def our_board(case: Case) -> Rig:
    return BenchRig(Bench(worst_case_of(case), primary=case.primary))


def test_the_cases_are_200_and_more_with_a_name_each_and_cite_what_is_there() -> None:
    assert len({case.name for case in CASES}) == len(CASES) >= 200
    cited = {RequirementSource.CAPTURED, RequirementSource.SCRIPT}
    assert {case.source for case in (*CASES, *WHOLE_CASES)} == set(RequirementSource) - cited
    sections = re.compile(r"(I|II|III|IV-A|IV-B|V-A|V-B|V-C|VI|Table I|equation \(2\)[^:]*)(: |$| from)")
    of_paper = [case.requirement for case in CASES if case.source is RequirementSource.PAPER]
    assert [it for it in of_paper if not sections.match(it)] == []


@pytest.mark.parametrize("state", WAYS_INTO, ids=lambda it: it.name)
def test_the_way_into_a_state_ends_in_it(state: State) -> None:
    primary, script = WAYS_INTO[state]
    rig = BenchRig(Bench(worst_case_board(), primary=primary))
    for word in script.split():
        rig.play(word)
    assert rig.bench.state is state


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_each_case_can_be_played_and_ours_passes(case: Case) -> None:
    assert judged(case, our_board, our_board, Died, {}).verdict is Verdict.PASSED


@pytest.mark.parametrize(
    ("script", "events"),
    [
        # Up at 3 s, docked at 73 s and charging 50 ms later, released an hour later, and down on the release.
        (
            DIVE.script,
            [
                "3.000 s motors float",
                "73.050 s charges",
                "3673.050 s stops charging",
                "3674.000 s motors sink",
            ],
        ),
        # A net brings it up after it sank; it floats, and 12 h (its float time-out) later it sinks.
        (
            "3s permission 70s sink 5min surfaced 13h",
            ["3.000 s motors float", "73.000 s motors sink", "43573.000 s motors sink"],
        ),
    ],
    ids=["a dive", "a net"],
)
def test_a_history_has_motors_and_charges_at_their_times_by_hand(script: str, events: list[str]) -> None:
    assert [str(it) for it in history(replace(DIVE, script=script), our_board, Died).events] == events


WORST = worst_case_board()
HOURS = Case("hours", RequirementSource.PAPER, "it draws its load", "8h")
CHOSEN = replace(DIVE, source=RequirementSource.CHOICE)
SLOW = replace(WORST, pin_debounce_ms=80)
HASTY = replace(WORST, release_wait_ms=0)


def drawing(permille: int) -> BoardConfig:
    drains = replace(WORST.charge, discharge=WORST.charge.discharge * permille // 1000)
    return replace(WORST, charge=drains)


# V-A: "detects a falling edge [...] and reacts to this by using its buoyancy motors": before any packet.
AT_THE_EDGE = CaseReading("at the edge", "3s permission 70s rises 1min falls 1s", board(HASTY))


@pytest.mark.parametrize(
    ("case", "config", "how", "verdict", "reason"),
    [
        pytest.param(DIVE, SLOW, {}, Verdict.FAILED, "expected 73.050 s charges", id="a slower debounce"),
        pytest.param(
            DIVE,
            replace(WORST, release_wait_ms=100),
            {},
            Verdict.FAILED,
            "expected 3674.000 s motors sink",
            id="no wait for the release",
        ),
        # 0.3 % of what flowed is the bound.
        pytest.param(HOURS, drawing(1002), {}, Verdict.PASSED, "", id="0.2 % of another load"),
        pytest.param(HOURS, drawing(1006), {}, Verdict.FAILED, "", id="0.6 % of another load"),
        pytest.param(CHOSEN, SLOW, {}, Verdict.DIFFERS, "", id="our own choice"),
        pytest.param(
            DIVE,
            SLOW,
            {"waivers": {"dive": "our contact is slow"}},
            Verdict.WAIVED,
            "our contact is slow (expected 73.050 s",
            id="a waived case names its reason",
        ),
        pytest.param(
            DIVE,
            HASTY,
            {"readings": [AT_THE_EDGE]},
            Verdict.DIFFERS,
            "at the edge (expected 3674.000 s motors sink, found it at 3673.050 s",
            id="another reading of the paper",
        ),
        pytest.param(
            DIVE,
            replace(WORST, release_wait_ms=500),
            {"readings": [AT_THE_EDGE]},
            Verdict.FAILED,
            "",
            id="neither reading of the paper",
        ),
        pytest.param(replace(DIVE, shows="state SINKING"), WORST, {}, Verdict.PASSED, "", id="what it cites"),
    ],
)
def test_a_board_that_differs(
    case: Case, config: BoardConfig, how: dict[str, Any], verdict: Verdict, reason: str
) -> None:
    result = judged(case, our_board, board(config), Died, **{"waivers": {}, **how})
    assert result.verdict is verdict and result.reason.startswith(reason)
    shows_where = any(line.startswith(" !") for line in side_by_side(result))
    assert shows_where or not reason


@pytest.mark.parametrize(
    "shows", ["sends", "state HOVERING", lambda packet: True], ids=["event", "state", "packet"]
)
def test_a_case_that_expects_nothing_of_what_it_cites_is_refused(
    shows: str | Callable[[Any], bool],
) -> None:
    with pytest.raises(AssertionError, match="the case dive expects nothing"):
        judged(replace(DIVE, shows=shows), our_board, our_board, Died, {})


def test_dead_firmware_fails_whatever_the_source() -> None:
    bench = Bench(WORST, primary=DIVE.primary)
    bench.run = Mock(side_effect=Died("it ended"))  # type: ignore[method-assign]
    result = judged(CHOSEN, our_board, lambda _: BenchRig(bench), Died, {})
    assert (result.verdict, result.reason) == (Verdict.FAILED, "its firmware failed: it ended")


class Shown(BenchRig):
    """A board whose history is given."""

    def __init__(self, shown: RigHistory) -> None:
        super().__init__(Bench(worst_case_board()))
        self._history = shown

    def shown(self) -> RigHistory:
        return self._history


@pytest.mark.parametrize(
    ("ends_ms", "verdict"), [(1021, Verdict.PASSED), (1030, Verdict.PASSED), (1050, Verdict.FAILED)]
)
def test_a_state_about_as_long_as_a_late_turn_may_be_on_one_board_alone(
    ends_ms: int, verdict: Verdict
) -> None:
    """By hand: ours lasts 20 ms, which two turns of 10 ms may take away or double; 50 ms are more."""
    began = RigEvent(0, "state FLOATING"), RigEvent(1000, "state RELEASED")
    ours, theirs = (
        RigHistory((), 0, 0, states=(*began, RigEvent(it, "state ACTIVE"))) for it in (1020, ends_ms)
    )
    assert judged(DIVE, ours, lambda _: Shown(theirs), Died, {}, late_ms=10).verdict is verdict


def test_a_packet_that_differs_is_told_by_its_fields() -> None:
    status = StatusPacket(1, 4, State.ACTIVE, 0.5, 0.9, 1.0, 2.0, 3.0, 70_000)
    ours, theirs = (
        RigHistory((RigEvent(900, f"sends {it.encode().hex()}"),), 0, 0)
        for it in (status, replace(status, sequence=5, state=State.SAMPLING))
    )
    lines = list(side_by_side(CaseResult(DIVE, Verdict.FAILED, "", ours, theirs)))
    assert lines[2].strip() == "its sequence is 5 and not 4; its state is SAMPLING and not ACTIVE"


def test_a_script_loses_every_word_that_it_does_not_need() -> None:
    def differs(case: Case) -> bool:
        words = case.script.split()
        return "rises" in words and "falls" in words[words.index("rises") :]

    long = replace(DIVE, script="3s permission 2min rises 1h ping falls 5min release")
    assert shrunk(long, differs).script == "rises falls"


def test_random_scripts_are_the_same_for_a_seed() -> None:
    one, again, other = ([case.script for case in random_cases(20, seed)] for seed in (1, 1, 2))
    assert one == again and not set(one) & set(other)


def test_an_unknown_word_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match="'jump' is neither a wait nor one of permission"):
        history(replace(DIVE, script="3s jump"), our_board, Died)


def test_a_script_s_time_is_that_of_its_waits_and_chatter() -> None:
    assert lasts_ms("3s 2min chatter:30:10:100 ping") == 3000 + 120_000 + 4000


TRACE = """\
# a trace by hand, of a board whose debounce is 80 ms
3.000 < permission
3.000 > motors float
73.000 < rises
73.080 > charges
100.0 < 0ms
"""


def test_a_captured_trace_judges_another_board() -> None:
    case, found = captured(TRACE, "reef")
    assert case.script == "3000ms permission 70000ms rises 80ms 26920ms 0ms"
    assert judged(case, found, board(SLOW), Died, {}).verdict is Verdict.PASSED
    result = judged(case, found, our_board, Died, {})
    told = "expected 73.080 s charges, found it at 73.050 s"
    assert (result.verdict, result.reason) == (Verdict.FAILED, told)


def test_a_trace_that_was_written_is_the_case_that_was_played() -> None:
    ours = history(DIVE, our_board, Died)
    case, found = captured("\n".join(traced(DIVE, ours)), "dive")
    again, full = (history(it, our_board, Died).events for it in (case, replace(DIVE, primary=1.0)))
    assert (found.events, again) == (ours.events, full)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("3 permission", "line 1: '3 permission' is not a time"),
        ("3 < ping\n2 < ping", "line 2: time goes back"),
    ],
)
def test_a_line_that_is_none_is_named(text: str, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        captured(text, "reef")


def costly(cost_ms: int, seed: int) -> Callable[[Case], Rig]:
    def made(hardware: Any) -> CostlyFirmware:
        return CostlyFirmware(Firmware(WORST, MusselbedCodec(), hardware, 0), cost_ms, seed)

    return lambda case: BenchRig(Bench(WORST, primary=case.primary, firmware=made))


@pytest.mark.parametrize("seed", range(3))
def test_firmware_that_takes_time_acts_late_and_passes(seed: int) -> None:
    """Four turns lead to the sinking, each of at most 5 ms, and one of them acts late at least."""
    events, again = (history(DIVE, costly(5, seed), Died).events for _ in range(2))
    late_ms = [
        found.at_ms - due_ms
        for found, due_ms in zip(events, (3000, 73_050, 3_673_050, 3_674_000), strict=True)
    ]
    assert events == again and all(0 <= it <= 10 for it in late_ms) and any(late_ms)
    assert judged(DIVE, our_board, costly(5, seed), Died, {}, 10).verdict is Verdict.PASSED


def test_a_turn_sees_the_pin_as_it_is_when_it_acts() -> None:
    """The pin is high for 1 ms: by hand, a turn that takes longer finds it low, and the edge never happened."""
    touch = replace(DIVE, script="3s permission 70s rises 1ms falls 5min")
    assert [it.what for it in history(touch, costly(5, 1), Died).events] == ["motors float"]


def keeps_a_refused_sink(firmware: Firmware, command: Command) -> list[Action]:
    if command.kind is Kind.SINK and firmware.state is State.CHARGING:
        firmware._clear_to_sink = True
    return EXECUTE(firmware, command)


def pings_are_refused(firmware: Firmware) -> list[Action]:
    return [Dropped(0, "a ping")]


EXECUTE = Firmware._execute
DOCTORED: dict[str, tuple[type, str, object]] = {
    "nothing-else-in-charging": (Firmware, "_execute", keeps_a_refused_sink),
    "ping-in-sinking": (Firmware, "_pinged", pings_are_refused),
    "a-tie-leaves-it-low": (ChargePin, "_certain", lambda pin, high: Edge.ROSE),
    "landed-in-released": (Firmware, "depth_changed", lambda firmware, now_ms: []),
    "empties-before-it-sinks": (Firmware, "level_reached", lambda firmware, level, now_ms: []),
    "a-release-kept-through-a-gap": (Firmware, "_pin_edge", lambda firmware, edge: []),
    "the-counter-wraps-in-a-boot-and-a-debounce": (
        Firmware,
        "_boot_trigger",
        lambda firmware: Trigger.BOOTED_AT_SURFACE,
    ),
}
"""A case of each family of requirements, and a firmware that breaks it."""


@pytest.mark.parametrize("name", DOCTORED)
def test_a_case_of_each_family_fails_a_board_that_breaks_it(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (case,) = (it for it in CASES if it.name == name)
    expected = history(case, our_board, Died)
    monkeypatch.setattr(*DOCTORED[name])
    assert judged(case, expected, our_board, Died, {}).verdict is Verdict.FAILED


def test_a_rig_ends_the_program_of_each_boot_whoever_else_holds_it() -> None:
    """A program may hold a serial line, which the next board needs."""
    config, made, closed = worst_case_board(), list[Program](), list[Program]()

    def make(hardware: Any) -> CostlyFirmware:
        made.append(Program(config, MusselbedCodec(), hardware, 0, closed))
        return CostlyFirmware(made[-1], 5, seed=1)

    rig = BenchRig(Bench(config, firmware=make))
    rig.play("brown_out")
    assert closed == made[:-1]
    rig.shown()
    assert closed == made and len(made) == 3


class Program(Firmware):
    """Notes when it is closed."""

    def __init__(
        self, config: BoardConfig, codec: MusselbedCodec, hardware: Any, now_ms: int, closed: list[Program]
    ) -> None:
        super().__init__(config, codec, hardware, now_ms)
        self._closed = closed

    def close(self) -> None:
        self._closed.append(self)
