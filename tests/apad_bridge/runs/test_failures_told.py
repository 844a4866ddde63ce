"""Failures reach a person: as lines while the flight goes on, and as counts in the summary."""

import re
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from journals import facts_of, lines_in

from agents.time_scale import MissionMs
from apad_bridge.assembly.division import members
from apad_bridge.events.all_events import event_of
from apad_bridge.events.mission_events import MissionEnd, StepGivenUp, Stuck
from apad_bridge.events.run_events import EndReason
from apad_bridge.events.vehicle_events import DocksDisagree
from apad_bridge.records.failure_counts import FailureCounts
from apad_bridge.records.recorder import Recorder
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.records.summary import Ending
from apad_bridge.runs.display import line_of
from apad_bridge.runs.in_memory import open_flight
from apad_bridge.runs.progress import FlightProgress
from apad_bridge.runs.progress_status import RunStatus
from apad_bridge.runs.several.lockstep import fly_in_step
from apad_bridge.scenario.blocks.guard_options import GuardOptions
from apad_bridge.scenario.choices import Hosting
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.supervisor.forecast import Forecast
from apad_bridge.vehicle.commands import BatteryReported, VehicleFact


def flown(scenario: Scenario, path: Path) -> tuple[RunDirectory, dict[str, Any], list[str]]:
    """The run's directory, its summary and the lines for a person."""
    scenario = replace(scenario, fleet=replace(scenario.fleet, hosting=Hosting.ONE_PROCESS))
    directory = RunDirectory.create(scenario.name, datetime.now(UTC), path / "run")
    with FlightProgress(scenario.name, round(scenario.duration_s * 1000), quiet=True) as progress:
        flown = fly_in_step(members(scenario, starts_of(scenario)), scenario.sharing, directory, progress)
    (summary,) = flown.summaries.values()
    return directory, summary, progress.messages


@pytest.fixture
def stuck(pool: Scenario) -> Scenario:
    """Its aPad does not move: ten go-tos fail in ten minutes, one each minute."""
    return replace(pool, duration_s=620.0, apad=replace(pool.apad, max_speed_m_s=1e-6))


def test_a_stuck_aPad_is_told_and_costs_nothing(stuck: Scenario, tmp_path: Path) -> None:
    directory, summary, lines = flown(stuck, tmp_path)
    assert (summary["cost_m"], summary["planned_m"]) == (
        pytest.approx(0.0, abs=0.01),
        pytest.approx(0.0, abs=20.0),  # the go-to that mission time cut off
    )
    journal = lines_in(directory.journal)
    given_up = [line for line in journal if line["kind"] == "given_up"]
    assert summary["steps_given_up"] == len(given_up) >= 8
    # One cause, whatever the metres to go.
    ((cause, count),) = summary["causes"].items()
    assert cause.startswith("stalled: not 0.5 m nearer within 60 s") and count == len(given_up)
    first = given_up[0]
    at = f"{first['t'] // 60_000:02d}:{first['t'] // 1000 % 60:02d}"
    assert f"{at}  aMussel {first['agent']} is not collected this time: {first['reason']}" in lines
    assert sum("go to point (" in line and ") failed: stalled" in line for line in lines) == count
    stuck_lines = [line for line in lines if "the aPad is stuck: 3 go-tos in a row failed" in line]
    assert len(stuck_lines) == 1
    # Nobody is left alone for what is the aPad's fault.
    assert summary["left_alone"] == [] and len(given_up) > 5


def test_aMussels_that_cannot_be_charged_are_left_alone_one_by_one(pool: Scenario) -> None:
    mission = replace(pool.mission, collection_attempts=2, silence_timeout_s=40.0)
    board = replace(pool.board, charge_segments=((1.0, 1e-7),))
    flight, recorder = open_flight(replace(pool, duration_s=2400.0, mission=mission, board=board))
    flight.run()
    events = [(kind, data) for _, kind, data in facts_of(recorder)]
    for agent_id in pool.fleet.ids:
        own = [kind for kind, data in events if data.get("agent") == agent_id]
        assert own.count("released") == 2 and own.count("left_alone") == 1, agent_id
    last = max(n for n, (kind, _) in enumerate(events) if kind == "left_alone")
    names = [
        data["name"] for kind, data in events[last:] if kind == "primitive" and data["phase"] == "started"
    ]
    assert names == ["hold position", "hold position"]  # in idle wait, and at the end
    line = line_of(1000, event_of(*events[last]))
    assert line is not None and "is left alone from now on: 2 tries in a row failed" in line


def test_the_counts_go_on_in_a_resumed_run(stuck: Scenario, tmp_path: Path) -> None:
    directory, summary, _ = flown(replace(stuck, duration_s=300.0), tmp_path)
    recorder, _ = Recorder.resume(directory, stuck, stuck.fleet.ids)
    recorder.event(MissionMs(301_000), StepGivenUp(3, "collect", "it does not come up"))
    again = recorder.finish(302_000, Ending(MissionEnd(EndReason.MISSION_TIME), 0.0, 0.0, 0, None, {}))
    assert again["steps_given_up"] == summary["steps_given_up"] + 1
    assert again["causes"] == summary["causes"] | {"it does not come up": 1}


FAILED = {"name": "go to point", "phase": "failed", "north_m": 1.0, "east_m": 2.0}
DANGER = {"cause": "position", "reaction": "stop", "reason": "it is old", "calls_pilot": True}
DRIFT = {"speed_m_s": 0.2, "towards_rad": 1.57, "fence_s": 40.0}
DIED = {"id": 7, "agent_ms": 5, "cause": "BROWN_OUT", "reason": "SIGKILL", "gave_up": None}


@pytest.mark.parametrize(
    ("kind", "data", "line"),
    [
        ("primitive", FAILED | {"reason": "pre-empted"}, None),  # is no failure
        ("primitive", FAILED | {"reason": "no GPS"}, "go to point (1.0 m north, 2.0 m east) failed: no GPS"),
        ("guard", DANGER, "PILOT, TAKE IT: the aPad's controllers go off: it is old"),
        (
            "guard",
            DANGER | {"cause": "fence ahead", "reaction": "hold", "calls_pilot": False},
            "the aPad holds where it is: it is old",
        ),
        ("guard_over", {"cause": "position"}, "no longer in danger (position)"),
        (
            "drift",
            DRIFT,
            "the aPad drifts without thrust, 0.20 m/s towards 90 degrees, at the fence or a keep-out zone in 40 s",
        ),
        ("continued", {"number": 1, "by": "Anna"}, "Anna continues after stop 1"),
        *(
            ("stop", {"number": 1, "mode": "hold", "by": "Anna", "state": state}, re.compile(line))
            for state, line in (
                *(
                    (it, r"stop 1 \(hold, by Anna\) is ")
                    for it in ("ordered", "sent", "taken", "not taken", "refused")
                ),
                ("at rest", r"stop 1 \(hold, by Anna\) has brought the aPad to rest"),
            )
        ),
        ("died", DIED, "the process of aMussel 7 died (SIGKILL), and was started again"),
        (
            "died",
            DIED | {"gave_up": "it died too often"},
            "the process of aMussel 7 died for good: it died too often",
        ),
    ],
)
def test_an_event_is_a_line(kind: str, data: dict[str, Any], line: str | re.Pattern[str] | None) -> None:
    told = line_of(61_000, event_of(kind, data))
    if isinstance(line, re.Pattern):
        assert told is not None and told.startswith("01:01  ") and line.search(told)
    else:
        assert told == (line and f"01:01  {line}")


GUARDED = {"guards": GuardOptions(battery_reserve=0.1)}


@pytest.mark.parametrize(
    ("unheard", "changes", "what", "stuck"),
    [
        pytest.param(VehicleFact, {}, "position", [], id="never heard"),
        pytest.param(
            BatteryReported,
            GUARDED,
            "battery",
            [(10_000, "its battery was not heard, and a guard refuses its go-tos until it is")],
            id="a guard refuses its go-tos",
        ),
    ],
)
def test_a_mission_says_what_it_waits_for(
    pool: Scenario, unheard: Any, changes: dict[str, Any], what: str, stuck: list[tuple[int, str]]
) -> None:
    flight, recorder = open_flight(replace(pool, area=replace(pool.area, home_m=(14.0, 10.5)), **changes))
    receive = flight.supervisor.receive
    flight.supervisor.receive = lambda it: isinstance(it, unheard) or receive(it)  # type: ignore[method-assign]
    for now_ms in range(0, 30_000, 1000):
        flight.tick(now_ms)
    assert RunStatus.of(flight.supervisor, 29_000, 0.0, Forecast()).phase == f"waits for the aPad's {what}"
    assert not flight.supervisor.mission.state.failed_tries
    told = [(at_ms, data["reason"]) for at_ms, kind, data in facts_of(recorder) if kind == Stuck.kind]
    assert told == stuck
    flight.supervisor.receive = receive  # type: ignore[method-assign]
    flight.tick(30_000)
    assert RunStatus.of(flight.supervisor, 30_000, 0.0, Forecast()).phase == "go to aMussel"


def test_what_guards_refuse_is_told_and_counted(pool: Scenario, tmp_path: Path) -> None:
    """Half of the pool is fenced off, and aMussels of the other half are planned for."""
    half = ((-4.0, -4.0), (32.0, -4.0), (32.0, 10.0), (-4.0, 10.0))
    fenced = replace(
        pool,
        duration_s=900.0,
        area=replace(pool.area, fence=half),
        apad=replace(pool.apad, start_m=(14.0, 5.0)),
    )
    directory, summary, lines = flown(fenced, tmp_path)
    refused = [line for line in lines_in(directory.journal) if line["kind"] == "refused"]
    assert {line["order"] for line in refused} == {"go to point", "permit to surface"}
    assert any("failed: refused: the goal (" in line and "outside the fence" in line for line in lines)
    assert any("is not permitted to surface: aMussel" in line for line in lines)
    assert any(cause.startswith("refused: the goal (") for cause in summary["causes"])
    assert any("would surface where no aPad may go" in cause for cause in summary["causes"])


def test_a_status_says_that_no_report_came_yet_and_by_how_much_the_flight_is_late(
    capsys: pytest.CaptureFixture[str],
) -> None:
    first = RunStatus(0, "by hand or script", "none", 0, 0, (), 0, 0.0, 1.0, 0.0)
    clock_s = 0.0
    with FlightProgress("pool", 600_000, clock=lambda: clock_s) as progress:
        progress.show_status(0, lambda: first)
        docking = replace(
            first, phase="by hand or script", primitive="dock", docked=(7, 3), active=8, agents=12
        )
        for minutes in (2.5, 5):
            clock_s = 4 * minutes
            status = replace(docking, now_ms=round(60_000 * minutes), behind_s=1.3)
            progress.show_status(status.now_ms, lambda status=status: status)  # type: ignore[misc]
    lines = [" ".join(line.split()) for line in capsys.readouterr().err.splitlines()]
    assert lines == [
        "00:00 / 10:00 by hand or script: waiting for first reports, none docked, 0 served, 0 m, aPad 100 %",
        "05:00 / 10:00 by hand or script (dock): 8/12 active, 7 3 docked, 0 served, 0 m, aPad 100 %, "
        "1.3 s behind real time; 00:20 left",
    ]


STOPPED = RunStatus(
    61_000, "by hand or script", "hold position", 12, 9, (), 3, 41.0, 0.9, 0.0, stopped="hold by Anna"
)


def test_a_stop_is_the_first_word_of_the_status(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """80 columns have no room for all, so the services and the metres follow at once."""
    with FlightProgress("pool", 600_000) as progress:
        progress.show_status(STOPPED.now_ms, lambda: STOPPED)
    line = " ".join(capsys.readouterr().err.split())
    assert line == "01:01 / 10:00 STOPPED: 3 served, 41 m, hold by Anna, aPad 90 %"
    monkeypatch.setenv("FORCE_COLOR", "1")  # a terminal, for rich
    monkeypatch.setenv("COLUMNS", "80")
    with FlightProgress("a-scenario-with-a-long-name", 600_000) as progress:
        progress.show_status(STOPPED.now_ms, lambda: STOPPED)
    shown = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", capsys.readouterr().err).splitlines()[-1]
    assert shown.lstrip("\r").startswith("STOPPED ") and "3 served, 41 m" in shown


def test_a_bar_makes_the_statuses_that_it_shows_and_no_others(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")  # a terminal, for rich
    monkeypatch.setenv("COLUMNS", "200")
    made: list[int] = []
    clock_s = 100.0
    with FlightProgress("pool", 600_000, clock=lambda: clock_s) as progress:
        for now_ms in range(0, 600_001, 1000):
            clock_s += 0.001
            progress.show_status(
                now_ms, lambda now_ms=now_ms: made.append(now_ms) or replace(STOPPED, now_ms=now_ms)
            )
    assert (made[0], made[-1]) == (0, 600_000)
    assert len(made) == 6  # 0.6 s of real time, eight of them a second, and the last one
    assert "10:00 / 10:00" in capsys.readouterr().err


FAILS = {"name": "dock", "phase": "failed", "reason": "it is jammed"}
WITNESS = "the vehicle reports it in a dock, the aMussel is not heard in it"


@pytest.mark.parametrize(
    ("events", "key", "figure"),
    [
        pytest.param(
            [
                event_of("dock", {"agent": 7, "closed": True, "dock": dock})
                if closed
                else event_of("primitive", FAILS | {"dock": dock})
                for dock, closed in ((0, 0), (0, 0), (1, 0), (2, 1), (2, 0), (2, 0), (3, 0), (3, 1), (0, 0))
            ],
            "failed_docks",
            [0],
            id="a dock that never closed has failed, and one that missed once has not",
        ),
        pytest.param(
            [DocksDisagree(agent_id, WITNESS) for agent_id in (3, 4)],
            "causes",
            {WITNESS: 2},
            id="a charge that no second witness proves is a cause with its count",
        ),
    ],
)
def test_what_is_counted(events: list[Any], key: str, figure: object) -> None:
    counts = FailureCounts()
    for event in events:
        counts.take(MissionMs(1000), event)
    assert counts.figures()[key] == figure
