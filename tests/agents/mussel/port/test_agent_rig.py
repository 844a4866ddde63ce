"""The kit's rig for whole boards: what it shows of our board, by hand and by the paper, and what its judge allows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import pytest

from agents.mussel.port.agent_rig import AgentRig
from firmware_model.actions import Action
from firmware_model.base_firmware import Firmware
from firmware_model.bench.conformance import (
    Case,
    RequirementSource,
    Verdict,
    Whole,
    history,
    judged,
    random_cases,
)
from firmware_model.bench.rigs import RigEvent, RigHistory, lasts_ms
from firmware_model.bench.whole_conformance_cases import WAYS_INTO, WHOLE_CASES
from firmware_model.hardware.clock_chip import Clock
from firmware_model.packets import Command, CommandPacket, Kind, StatusPacket, WifiStatus, decode
from firmware_model.power.active_battery import ActiveBattery
from firmware_model.power.charge_pin import ChargePin, Edge
from firmware_model.settings import Settings
from firmware_model.settings_store import SettingsStore
from firmware_model.states import State
from firmware_model.stimuli import ResetCause
from firmware_model.whole_firmware import WholeFirmware

CASES = {case.name: case for case in WHOLE_CASES}
NO_EVENT = ("wakes-hourly", "stays-down")


class Died(Exception):
    """The firmware of a test's board."""


def shown(case: Case) -> RigHistory:
    return history(case, AgentRig, Died)


def test_the_cases_are_500_with_a_name_each() -> None:
    assert len(WHOLE_CASES) >= 500
    assert len(CASES) == len(WHOLE_CASES)
    assert all(case.whole is not None for case in WHOLE_CASES)


@pytest.mark.parametrize("state", WAYS_INTO, ids=lambda it: it.name)
def test_the_way_into_a_state_ends_in_it(state: State) -> None:
    whole, primary, script = WAYS_INTO[state]
    rig = AgentRig(replace(CASES["surfaces"], whole=whole, primary=primary))
    for word in script.split():
        rig.play(word)
    assert rig.agent.board.state is state


def test_there_is_a_way_into_each_state_but_off() -> None:
    assert set(WAYS_INTO) == set(State) - {State.OFF}


@pytest.mark.parametrize("name", [name for name in CASES if name.startswith("table-1")])
def test_our_board_has_the_times_of_the_paper_s_table_one(name: str) -> None:
    """The judge of these is the paper: ours need not be asked."""
    found = shown(CASES[name])
    assert judged(CASES[name], found, AgentRig, Died, {}).verdict is Verdict.PASSED
    late = tuple(replace(it, at_ms=it.at_ms * 1007 // 1000) for it in found.ends)
    result = judged(CASES[name], found, fixed(replace(found, ends=late)), Died, {})
    assert result.verdict is Verdict.FAILED
    assert "in the paper, and here after" in result.reason


def fixed(found: RigHistory) -> Callable[[Case], Any]:
    """Rigs that show this history, whatever is played."""
    return lambda case: Mock(AgentRig, **{"shown.return_value": found})


SINK = CommandPacket(Kind.SINK, 1)
PLAYS: dict[str, tuple[Case, list[str], list[str]]] = {
    # Up at 3 s, there at 63 s; its dock charges at once; released and told to sink, it runs its motors once more.
    "a dive": (
        Case(
            "dive",
            RequirementSource.PAPER,
            "",
            "3s permission 70s rises 10min falls 1s release 5min",
            0.4,
            whole=Whole(),
        ),
        [],
        ["3.000 s motors float", "73.000 s charges", "673.000 s stops charging", "674.000 s motors sink"],
    ),
    "a dock below is a pin that rises without a charger": (
        replace(CASES["surfaces"], script="10min rises 5min falls 5min"),
        ["600.050 s state CHARGING", "900.050 s state RELEASED", "1020.050 s state ACTIVE"],
        ["1020.050 s motors sink"],
    ),
    # Lifted at 100 s it floats; told to sink at 110 s, put down at 115 s; then 2 min up.
    "a hand brings a body up and down, and it may travel slowly": (
        replace(
            CASES["surfaces"],
            script=f"100s surfaced 10s wifi:{SINK.encode().hex()} 5s landed 1s travel:2min permission 3min",
        ),
        [
            "100.000 s state FLOATING",
            "110.000 s state SINKING",
            "115.000 s state ACTIVE",
            "116.000 s state SURFACING",
            "236.000 s state FLOATING",
        ],
        ["110.000 s motors sink", "116.000 s motors float"],
    ),
}
"""By hand: a script's states after those of the boot, where they are looked at, and its events."""


@pytest.mark.parametrize(("case", "states", "events"), PLAYS.values(), ids=PLAYS)
def test_what_a_script_plays(case: Case, states: list[str], events: list[str]) -> None:
    found = shown(case)
    assert [str(it) for it in found.events] == events
    assert [str(it) for it in found.states or ()][3 : 3 + len(states)] == states


def test_a_report_of_the_experiment_is_a_status_of_the_board() -> None:
    events = shown(CASES["reports-when-asked"]).events
    sent = [it for it in events if it.what.startswith("sends by Wi-Fi ")]
    assert [it.at_ms for it in sent[:3]] == [600_000, 1_200_000, 1_800_000]
    status = decode(bytes.fromhex(sent[-1].what.rpartition(" ")[2]))
    assert isinstance(status, WifiStatus)
    assert (status.reset_cause, status.feed) == (ResetCause.WATCHDOG, ActiveBattery.PRIMARY)
    assert status.state is State.FLOATING


@pytest.mark.parametrize(("name", "offset_ms"), [("ahead", 70_000), ("behind", -300)])
def test_a_report_tells_the_clock_minus_the_beacon(name: str, offset_ms: int) -> None:
    """By hand: at 600 s the clock is 70 s ahead of a beacon that tells 530 s, and 0.3 s behind one of 600.3 s."""
    sent = (
        decode(bytes.fromhex(it.what.split()[-1]))
        for it in shown(CASES[f"reports-a-clock-{name}"]).events
        if " by " in it.what
    )
    assert [it.clock_offset_ms for it in sent if isinstance(it, WifiStatus)] == [offset_ms, 0]


STATUS = StatusPacket(1, 4, State.ACTIVE, 0.5, 0.9, 1.0, 2.0, 3.0, 70_000)
CASE = Case("status", RequirementSource.PACKETS, "", "1s", whole=Whole())


def sent(status: StatusPacket) -> RigHistory:
    return RigHistory((RigEvent(900, f"sends by sound {status.encode().hex()}"),), 0, 0)


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({"agent_ms": 70_020}, Verdict.PASSED),
        ({"agent_ms": 70_061}, Verdict.FAILED),
        ({"primary": 0.503}, Verdict.PASSED),
        ({"primary": 0.505}, Verdict.FAILED),
        ({"secondary": 0.905}, Verdict.FAILED),
        ({"sequence": 5}, Verdict.FAILED),
        ({"depth_m": 3.01}, Verdict.FAILED),
        ({"state": State.SAMPLING}, Verdict.FAILED),
    ],
    ids=str,
)
def test_a_packet_may_differ_in_its_time_and_its_charges_by_their_tolerance(
    changes: dict[str, object], verdict: Verdict
) -> None:
    found = sent(replace(STATUS, **changes))  # type: ignore[arg-type]
    assert judged(CASE, sent(STATUS), fixed(found), Died, {}).verdict is verdict


@pytest.mark.parametrize("word", ["jump", "travel:60", "loses:much"])
def test_a_word_that_no_rig_has_is_refused(word: str) -> None:
    with pytest.raises(ValueError, match=r"is neither a wait nor one of permission.*loses:PERCENT"):
        AgentRig(CASE).play(word)


def keeps_a_refused_sink(firmware: WholeFirmware, command: Command) -> list[Action]:
    if command.kind is Kind.SINK and firmware.state is State.REPORTING:
        firmware._clear_to_sink = True
    return EXECUTE(firmware, command)


EXECUTE = WholeFirmware._execute
DOCTORED: dict[str, tuple[type, str, object]] = {
    "nothing-else-in-reporting": (WholeFirmware, "_execute", keeps_a_refused_sink),
    "a-tie-leaves-it-low": (ChargePin, "_certain", lambda pin, high: Edge.ROSE),
    "surfaced-in-transmitting": (WholeFirmware, "depth_changed", lambda board, now_ms: []),
    "emptied-in-awaiting-slot": (WholeFirmware, "level_reached", lambda board, level, now_ms: []),
    "both-emptied-in-floating": (WholeFirmware, "level_reached", lambda board, level, now_ms: []),
    "a-beacon-in-booting": (WholeFirmware, "_set_clock", lambda board, agent_ms: []),
    "settings-in-hovering": (WholeFirmware, "_change_setting", lambda board, command: []),
    "a-log-order-in-released": (WholeFirmware, "_extend_report", lambda board, action: []),
    "a-ping-as-it-falls-asleep": (WholeFirmware, "_pinged", lambda board: []),
    "a-dock-ends-its-calls": (WholeFirmware, "_pin_edge", Firmware._pin_edge),
    "bounds-a-wake-as-long-as-its-period": (SettingsStore, "apply", lambda store, command, now_ms: True),
    "hovers-here-after-a-depth": (WholeFirmware, "_hover_mm", lambda board: 1250),
    "an-offset-beyond-its-frame-late": (Settings, "transmits_at_ms", lambda it, reading_ms: reading_ms),
    "in-doubt-at-its-slot": (Clock, "doubt_ms", lambda clock, at_ms, bound_ppb: 0),
    "a-beacon-dispels-it": (WholeFirmware, "_apply_if_allowed", lambda board, trigger: []),
}
"""A case of each family of requirements, and a firmware that breaks it."""


@pytest.mark.parametrize("name", DOCTORED)
def test_a_case_of_each_family_fails_a_board_that_breaks_it(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = shown(CASES[name])
    monkeypatch.setattr(*DOCTORED[name])
    assert judged(CASES[name], expected, AgentRig, Died, {}).verdict is Verdict.FAILED


def test_random_histories_visit_every_state_and_last_up_to_two_days() -> None:
    """Those of a seed that the faults of states which a short script never reaches would show in."""
    cases = list(random_cases(40, 1, is_whole=True))
    assert sorted(lasts_ms(it.script) for it in cases)[20] > 12 * 3_600_000
    assert max(lasts_ms(it.script) for it in cases) <= 48 * 3_600_000
    visited = {it.what for case in cases for it in shown(case).states or ()}
    assert visited == {f"state {it.name}" for it in State if it is not State.OFF}


@pytest.mark.parametrize(
    "state", [State.AWAITING_BEACON, State.CALLING, State.AWAITING_SLOT], ids=lambda it: it.name
)
def test_random_histories_find_a_board_that_stays_in_a_rare_state(
    state: State, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A board that does not leave the state when a battery is empty or its time is over."""
    cases = list(random_cases(40, 1, is_whole=True))
    expected = [shown(it) for it in cases]
    deadline_of = WholeFirmware._deadline_of
    monkeypatch.setattr(
        WholeFirmware,
        "_deadline_of",
        lambda board, of, now_ms: None if of is state else deadline_of(board, of, now_ms),
    )
    verdicts = [
        judged(case, ours, AgentRig, Died, {}).verdict for case, ours in zip(cases, expected, strict=True)
    ]
    assert Verdict.FAILED in verdicts
