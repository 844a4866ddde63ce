"""The socket in a run's directory by which commands give a supervisor orders."""

import json
import math
import os
import re
import resource
import socket
import stat
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from flying import Flying, play
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from journals import facts_of

from apad_bridge.commands import main
from apad_bridge.events.guard_events import StopKind
from apad_bridge.events.mission_events import Phase
from apad_bridge.events.person_events import PersonOrdered
from apad_bridge.events.person_orders import Act
from apad_bridge.events.run_events import EndReason
from apad_bridge.mission.call_queue import CallQueue
from apad_bridge.mission.flight_mission import FlightMission
from apad_bridge.mission.orders import StopVehicle
from apad_bridge.mission.script_values import Status
from apad_bridge.records.recorder import RecordsFailed
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor import control_server
from apad_bridge.supervisor.clock import FlightSpeed
from apad_bridge.supervisor.control_protocol import (
    SOCKET_NAME,
    Answer,
    NobodyListens,
    Request,
    ask,
    short_path,
)
from apad_bridge.supervisor.control_server import carry_out, control_offered
from apad_bridge.vehicle.link_errors import PeerFailed


@pytest.fixture
def run_dir(tmp_path: Path) -> Path:
    """Its path is longer than a Unix socket's address may be."""
    path = tmp_path / ("long" * 30)
    path.mkdir()
    (path / "scenario.yaml").touch()
    return path


@pytest.fixture
def flying(pool: Scenario, run_dir: Path) -> Iterator[Flying]:
    flying = Flying(pool)
    flying.seconds(3)
    with control_offered(run_dir, flying.calls, flying.gate):
        yield flying


TOLD: dict[str, Callable[[dict[str, Any]], str]] = {
    "override": lambda it: "taken" if it["taken"] else "given back",
    "operator": lambda it: f"{it['by']} orders {it['order']}",
    "stop": lambda it: f"stop {it['number']} {it['mode']} {it['state']}",
    "continued": lambda it: f"stop {it['number']} is over",
    "refused": lambda it: f"refused by {it['guard']}",
    "speed": lambda it: f"speed {it['times']:g}",
}
"""The events that a transcript shows."""


class Orders(Flying):
    """A fenced flight that a story's commands and requests reach through the socket of its directory."""

    def __init__(self, pool: Scenario, run_dir: Path, capsys: pytest.CaptureFixture[str]) -> None:
        fence = ((-4.0, -4.0), (32.0, -4.0), (32.0, 25.0), (-4.0, 25.0))
        super().__init__(replace(pool, area=replace(pool.area, fence=fence)))
        self._run_dir, self._capsys = run_dir, capsys
        self.speed = FlightSpeed(20.0)
        self._shown = 0

    def answer(self, move: str) -> str:
        """The answer to a line's move, and what the flight told since the line before."""
        said, facts = self.do(move), facts_of(self.records)
        shown = [TOLD[kind](data) for _, kind, data in facts[self._shown :] if kind in TOLD]
        self._shown = len(facts)
        return "; ".join(it for it in (said, *shown) if it)

    def do(self, move: str) -> str:
        name, *words = move.split()
        numbers = [float(it) for it in words if re.fullmatch(r"[\d.e-]+", it)]
        match name:
            case "seconds":
                self.seconds(int(words[0]))
            case "until":
                self.until(lambda: move.endswith(str(self.seen)))
            case "phase":
                return self.phase.value
            case "at":
                pose = self.flight.supervisor.pose
                return str(pose is not None and math.dist((pose.north_m, pose.east_m), numbers) < 1)
            case "passes":
                return str([self.speed.lets_pass(round(it)) for it in numbers])
            case "ask":
                act, times = (
                    Act(words[0].replace("_", " ")),
                    numbers[0] if words[0] == "speed" and numbers else None,
                )
                goal_m, speed_m_s = tuple(numbers[:2]), numbers[2] if len(numbers) > 2 else None
                request = Request(
                    act, "Anna", goal_m=goal_m if len(goal_m) == 2 else None, speed_m_s=speed_m_s, times=times
                )
                speed = self.speed if "own" in words else None
                asked = lambda: control_server.carry_out(request, self.calls, self.gate, speed=speed)  # noqa: E731
                answer = asked() if "at_once" in words else self.answered(asked)
                return ", ".join(
                    it for it in ("yes" if answer.accepted else "no", answer.message, answer.steers) if it
                )
            case _:
                command = [name, str(self._run_dir), *words]
                try:
                    code = self.answered(lambda: main.main(command))
                except SystemExit as ended:
                    code = ended.code
                told = self._capsys.readouterr()
                return f"{code}: {' '.join((told.out + told.err).split())}"
        return ""

    @property
    def seen(self) -> str:
        return "done" if self.calls.wait(0).goto is Status.DONE else self.phase.value


STORIES = {
    "commands give orders and print the answers": """
        seconds 3             |
        stop --by Anna --json | 0: {..."accepted": true, ... "stop": 1, "mode": "hold", "state": "obeyed"...;
                              | Anna orders stop; taken; stop 1 hold ordered; stop 1 hold sent;
                              | stop 1 hold taken; stop 1 hold obeyed
        phase                 | by hand or script
        seconds 5             | stop 1 hold at rest
        stop                  | 0: stop 2 (off): ordered, sent after 0.0 s, taken ... nobody steers: ...;
                              | ... orders stop; stop 2 off ordered; stop 2 off sent; stop 2 off taken;
                              | stop 2 off obeyed
        continue --stop 1     | 3: stop 1 is not in force: stop 2 (off, by ...) is in force...
        continue --stop 2     | 0: done; the mission steers...;
                              | given back; ... orders continue; refused by person; stop 2 is over
        abort                 | 0: done...; ... orders abort
        stop                  | 3: the mission is over: a call: abort by ...
    """,
    "an abort with motors off waits until the controllers are off": """
        seconds 3          |
        abort --motors-off | 0: done...; ... orders stop; taken;
                           | stop 1 off ordered; stop 1 off sent; stop 1 off taken; stop 1 off obeyed;
                           | ... orders abort
        phase              | ended
    """,
    "the way back in needs a lookout and a place outside": """
        seconds 3            |
        back-in              | 2: ...--lookout
        back-in --lookout Bo | 3: the aPad is inside the fence...
    """,
    "a go-to takes the aPad over and moves it, a hold follows, and it is given back": """
        until go to aMussel |
        ask go_to 20 15 0.4 | yes, a person steers: ...; Anna orders go to; taken
        phase               | by hand or script
        until done          |
        at 20 15            | True
        ask hold 18 15      | yes, a person steers: ...; Anna orders hold
        phase               | by hand or script
        ask give_back       | yes, the mission steers; given back; Anna orders give back
        phase               | go to aMussel
    """,
    # No stopped order is left to go on with.
    "a go-to replaces the one that was stopped": """
        until go to aMussel |
        ask go_to 20 15     | yes, a person steers: ...; Anna orders go to; taken
        seconds 2           |
        ask stop            | yes, a person steers: ...; Anna orders stop; stop 1 hold ordered; stop 1 hold sent;
                            | stop 1 hold taken; stop 1 hold obeyed
        ask go_to 14 5      | yes, a person steers: ...; Anna orders go to; stop 1 is over
        until done          |
        at 14 5             | True
        ask continue        | no, nothing was stopped: there is nothing to continue;
                            | a person steers: ...
        ask give_back       | yes, the mission steers; given back; Anna orders give back
        phase               | go to aMussel
    """,
    "a go-to or a hold that is refused leaves the mission flying": """
        until go to aMussel |
        ask go_to 20 40     | no, refused: the goal (20.0 m north, 40.0 m east) lies 15.0 m outside the fence;
                            | refused by fence
        ask hold 20 40      | no, refused: the goal (20.0 m north, 40.0 m east) lies 15.0 m outside the fence;
                            | refused by fence
        ask go_to 20 15 9.0 | no, a speed of 9 m/s: apad.max_speed_m_s is 1 m/s
        ask hold 20 15 9.0  | no, a speed of 9 m/s: apad.max_speed_m_s is 1 m/s
        ask go_to 1e6 0     | no, the goal lies 1000000 m from the scenario's origin...
        ask hold 1e6 0      | no, the goal lies 1000000 m from the scenario's origin...
        ask go_to           | no, an order to go to needs a goal
        ask hold            | no, an order to hold needs a goal
        phase               | go to aMussel
    """,
    # Without a tick only a stop is kept, for the next one.
    "a flight's speed changes by a person, and a stop waits while time stands": """
        seconds 3             |
        ask speed own         | no, a step takes `musselbed speed RUN 0` first
        ask speed 5 own       | yes, the flight's speed is 5 times real time; speed 5
        ask speed 0 own       | yes, mission time stands still; speed 0
        passes 1000           | [False]
        ask abort own at_once | no, mission time stands still: `musselbed speed RUN 1` or `musselbed speed RUN step` first
        ask stop own at_once  | no, no mission tick came within 0.1 s: it goes out with the next tick
        ask speed own         | yes, mission time stands still; Anna orders stop; taken; speed 0;...
        phase                 | by hand or script
        passes 500 1000 1500  | [True, True, False]
        ask speed 2 own       | yes, the flight's speed is 2 times real time; speed 2...
    """,
    "a time that is not the flight's own has no speed": """
        seconds 3   |
        ask speed 5 | no, only a simulated aPad on the run's own master has a speed to change;
                    | to stop the aPad: musselbed stop RUN
    """,
}


@pytest.mark.parametrize("story", STORIES.values(), ids=STORIES)
def test_story(pool: Scenario, run_dir: Path, capsys: pytest.CaptureFixture[str], story: str) -> None:
    orders = Orders(pool, run_dir, capsys)
    with control_offered(run_dir, orders.calls, orders.gate):
        play(story, orders.answer)


@pytest.mark.parametrize("times", [-1.0, math.inf])
def test_a_speed_has_its_range(times: float) -> None:
    assert "0.01 to 10000" in Request(Act.SPEED, "Anna", times=times).mistake


def test_a_stop_needs_no_position_and_hands_still_the_arms(pool: Scenario, run_dir: Path) -> None:
    flying = Flying(pool)
    with control_offered(run_dir, flying.calls, flying.gate):
        assert flying.answered(lambda: main.main(["hands", str(run_dir)])) == 0
    assert [(it["mode"], it["state"]) for it in flying.events("stop")][-1] == ("off", "obeyed")
    assert flying.gate.stops.in_force is not None and flying.gate.stops.in_force.stills_arms


class AtOnce(CallQueue):
    """Runs a call within the tick under way."""

    def __init__(self, mission: FlightMission) -> None:
        super().__init__()
        self.mission = mission

    def call_mission(self, act: Callable[[FlightMission], Any], timeout_s: float = 0.0, **_: Any) -> Any:
        return act(self.mission)


MOVES = {
    "continue": Request(Act.CONTINUE, "Anna", stop=1),
    "give back": Request(Act.GIVE_BACK, "Anna"),
    "go-to": Request(Act.GO_TO, "Anna", goal_m=(14.0, 5.0)),
    "hold": Request(Act.HOLD, "Anna", goal_m=(14.0, 5.0)),
}


@pytest.mark.parametrize("order", MOVES.values(), ids=MOVES)
def test_nobody_moves_the_apad_by_a_word_of_the_tick_in_which_another_has_hands_at_the_docks(
    pool: Scenario, order: Request
) -> None:
    flying, answers = Flying(pool), list[Answer]()
    flying.seconds(5)
    assert flying.answered(lambda: carry_out(Request(Act.STOP, "Anna"), flying.calls, flying.gate)).accepted

    def in_one_tick(mission: FlightMission) -> None:
        mission.order(StopVehicle("Bo", hands=True))
        answers.append(carry_out(order, AtOnce(mission), flying.gate))

    flying.call_mission(in_one_tick)
    flying.seconds(1)
    assert not answers[0].accepted and "at this very moment" in answers[0].message
    assert (stop := flying.gate.stops.in_force) is not None and (stop.number, stop.stills_arms) == (2, True)


def test_a_stop_reaches_the_vehicle_in_the_tick_in_which_the_disk_is_full(
    flying: Flying, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(now_ms: int, event: object) -> None:
        raise RecordsFailed("full", EndReason.DISK_FULL)

    def in_this_tick(mission: FlightMission) -> None:
        mission.emit(PersonOrdered("motors off", "Anna"))
        mission.order(StopVehicle("Anna", off=True))
        monkeypatch.setattr(flying.flight._recorder, "event", full)

    with pytest.raises(RecordsFailed):
        flying.call_mission(in_this_tick)
    assert (stop := flying.gate.stops.in_force) is not None and stop.kind is StopKind.OFF


def test_a_go_to_that_is_refused_ends_no_stop(pool: Scenario) -> None:
    """No mission plans: the order that the stop has paused goes on first."""
    flying = Flying.by_calls(pool)
    flying.seconds(3)
    flying.call(lambda manual: manual.go_to(20.0, 12.0))
    flying.seconds(3)
    flying.answered(lambda: carry_out(Request(Act.STOP, "Anna"), flying.calls, flying.gate))
    answer = flying.answered(lambda: carry_out(MOVES["go-to"], flying.calls, flying.gate))
    assert not answer.accepted and "continue first" in answer.message
    assert flying.gate.stops.in_force is not None


@pytest.mark.parametrize("act", Act)
def test_every_act_is_carried_out_or_refused_with_a_reason(flying: Flying, act: Act) -> None:
    """None is declared alone: without its part in the supervisor an order would end the supervisor's thread."""
    request = Request(act, "Anna", "a boat", lookout="Bo", goal_m=(5.0, 5.0), times=1.0)
    answer = flying.answered(lambda: control_server.carry_out(request, flying.calls, flying.gate))
    # Nothing is stopped, the aPad is inside, and its time is not the flight's own.
    assert answer.accepted is (act not in (Act.CONTINUE, Act.BACK_IN, Act.SPEED))
    assert answer.accepted or answer.message


def test_only_this_user_may_connect_and_the_socket_goes_with_its_supervisor(
    flying: Flying, run_dir: Path, monkeypatch: pytest.MonkeyPatch, pool: Scenario
) -> None:
    assert stat.S_ISSOCK((run_dir / SOCKET_NAME).stat().st_mode)
    monkeypatch.setattr(control_server, "is_of_our_user", lambda link: False)
    with pytest.raises(PeerFailed, match="does not answer"):
        ask(run_dir, Request(Act.STOP, "Mallory"))
    assert flying.phase is not Phase.COMMANDED


@pytest.mark.parametrize(
    ("left", "told"),
    [
        pytest.param([], "is no run: name the directory", id="no run"),
        pytest.param(["scenario.yaml"], "no supervisor of", id="nobody flies it"),
        # What a killed supervisor leaves.
        pytest.param(["scenario.yaml", SOCKET_NAME], "continue with: musselbed resume ", id="killed"),
        pytest.param(["scenario.yaml", SOCKET_NAME, "summary.json"], "it has ended", id="ended"),
    ],
)
def test_without_a_supervisor_the_command_says_what_can_be_done(
    left: list[str],
    told: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in left:
        if name == SOCKET_NAME:
            with socket.socket(socket.AF_UNIX) as killed:
                killed.bind(SOCKET_NAME)
        else:
            (tmp_path / name).write_text("{}")
    assert main.main(["stop", str(tmp_path)]) == 2
    assert told in capsys.readouterr().err


def test_a_dead_supervisors_socket_is_replaced_and_its_own_removed(run_dir: Path, pool: Scenario) -> None:
    (run_dir / SOCKET_NAME).write_text("left over")
    flying = Flying(pool)
    with control_offered(run_dir, flying.calls, flying.gate):
        request = Request(Act.REMARK, "Anna", "after the crash")
        assert flying.answered(lambda: ask(run_dir, request)) == Answer(True, "")
    assert not (run_dir / SOCKET_NAME).exists()
    with pytest.raises(NobodyListens):
        ask(run_dir, request)


def test_a_client_that_says_nothing_delays_nobodys_stop(flying: Flying, run_dir: Path) -> None:
    silent = [connected(run_dir) for _ in range(20)]
    assert flying.answered(lambda: ask(run_dir, Request(Act.STOP, "Anna"))).accepted
    for link in silent:
        link.close()


def test_a_stop_comes_through_where_the_process_may_open_no_further_file(
    flying: Flying, run_dir: Path
) -> None:
    """Its connection is accepted by a descriptor of the reserve."""
    link = socket.socket(socket.AF_UNIX)
    link.settimeout(30)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    opened: list[int] = []
    with short_path(run_dir) as path:
        # Above every descriptor that the tests before have left open: one above the limit gives its place to nobody.
        highest = max(int(it) for it in os.listdir("/proc/self/fd"))
        resource.setrlimit(resource.RLIMIT_NOFILE, (highest + 16, hard))
        try:
            with pytest.raises(OSError, match="Too many open files"):
                while True:
                    opened.append(os.open(os.devnull, os.O_RDONLY))
            link.connect(path)
            link.sendall(b'{"act": "stop", "by": "Anna"}\n')
            answer = flying.answered(lambda: link.recv(4096))
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
            for it in opened:
                os.close(it)
            link.close()
    assert json.loads(answer)["state"] == "obeyed"


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.one_of(
        st.binary(max_size=200),
        st.recursive(
            st.none() | st.integers() | st.text(), lambda it: st.lists(it) | st.dictionaries(st.text(), it)
        ).map(lambda it: json.dumps(it).encode()),
        st.just(b'{"act": "stop", "by": ""}'),
        st.just(b'{"act": "fly", "by": "Anna"}'),
        st.just(b"[" * 16_000),
    )
)
def test_what_is_no_request_is_answered_and_counted_and_orders_nothing(
    flying: Flying, run_dir: Path, data: bytes
) -> None:
    with connected(run_dir) as link:
        link.sendall(data.replace(b"\n", b" ") + b"\n")
        line = link.makefile("rb").readline()
    assert json.loads(line)["accepted"] is False
    assert not flying.calls._calls


def test_dropped_requests_are_counted_by_reason(run_dir: Path, pool: Scenario) -> None:
    with control_offered(run_dir, (unflown := Flying(pool)).calls, unflown.gate) as dropped:
        for _ in range(3):
            with connected(run_dir) as link:
                link.sendall(b"stop\n")
                assert b"cannot be read" in link.makefile("rb").readline()
        with connected(run_dir) as link:  # as a console looks whether anybody listens
            link.shutdown(socket.SHUT_WR)
            assert link.makefile("rb").readline() == b""
        assert dropped == {"orders that cannot be read": 3}


def test_a_supervisor_that_does_not_tick_is_told_of_and_only_a_stop_stays(
    run_dir: Path, pool: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    flying = Flying(pool)
    call = flying.calls.call_mission
    monkeypatch.setattr(
        flying.calls, "call_mission", lambda act, timeout_s=0, stays=False: call(act, 0.05, stays=stays)
    )
    with control_offered(run_dir, flying.calls, flying.gate):
        answer = ask(run_dir, Request(Act.CONTINUE, "Anna"))
        assert answer == Answer(False, "no mission tick came within 0.05 s: nothing was ordered")
        stop = ask(run_dir, Request(Act.STOP, "Anna"))
        assert stop == Answer(False, "no mission tick came within 0.05 s: it goes out with the next tick")
    flying.seconds(3)
    assert [it["order"] for it in flying.events("operator")] == ["stop"]
    assert "taken" in [it["state"] for it in flying.events("stop")]


def connected(run_dir: Path) -> socket.socket:
    link = socket.socket(socket.AF_UNIX)
    link.settimeout(30)
    with short_path(run_dir) as path:
        link.connect(path)
    return link
