"""The socket in a run's directory by which commands give a supervisor orders."""

import json
import math
import os
import resource
import socket
import stat
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from flying import Flying
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from apad_bridge.commands import main
from apad_bridge.events.mission_events import Phase
from apad_bridge.events.person_orders import Act
from apad_bridge.mission.script_values import Status
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
from apad_bridge.supervisor.control_server import control_offered
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


def test_a_command_gives_an_order_and_prints_the_answer(
    flying: Flying, run_dir: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert flying.answered(lambda: main.main(["stop", str(run_dir), "--by", "Anna", "--json"])) == 0
    assert flying.phase is Phase.COMMANDED
    told = json.loads(capsys.readouterr().out)[run_dir.name]
    assert (told["accepted"], told["stop"], told["mode"], told["state"]) == (True, 1, "hold", "obeyed")
    assert [it["state"] for it in flying.events("stop")] == ["ordered", "sent", "taken", "obeyed"]
    flying.seconds(5)
    assert flying.events("stop")[-1]["state"] == "at rest"
    assert flying.answered(lambda: main.main(["stop", str(run_dir)])) == 0
    assert "stop 2 (off): ordered, sent after 0.0 s, taken" in capsys.readouterr().out
    assert flying.answered(lambda: main.main(["continue", str(run_dir), "--stop", "1"])) == 3
    assert "stop 1 is not in force: stop 2 (off" in capsys.readouterr().out
    assert flying.answered(lambda: main.main(["continue", str(run_dir), "--stop", "2"])) == 0
    assert [it["number"] for it in flying.events("continued")] == [2]
    assert flying.answered(lambda: main.main(["abort", str(run_dir)])) == 0
    flying.calls.close("the flight is over")
    assert main.main(["stop", str(run_dir)]) == 3
    assert "the mission is over" in capsys.readouterr().out


def test_an_abort_with_motors_off_waits_until_the_controllers_are_off(flying: Flying, run_dir: Path) -> None:
    assert flying.answered(lambda: main.main(["abort", str(run_dir), "--motors-off"])) == 0
    assert flying.phase is Phase.ENDED
    assert [(it["mode"], it["state"]) for it in flying.events("stop")][-1] == ("off", "obeyed")


def test_a_stop_needs_no_position_and_hands_still_the_arms(pool: Scenario, run_dir: Path) -> None:
    flying = Flying(pool)
    with control_offered(run_dir, flying.calls, flying.gate):
        assert flying.answered(lambda: main.main(["hands", str(run_dir)])) == 0
    assert [(it["mode"], it["state"]) for it in flying.events("stop")][-1] == ("off", "obeyed")
    assert flying.gate.stops.in_force is not None and flying.gate.stops.in_force.stills_arms


def test_the_way_back_in_needs_a_lookout_and_a_place_outside(
    flying: Flying, run_dir: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main.main(["back-in", str(run_dir)])
    assert "--lookout" in capsys.readouterr().err
    assert flying.answered(lambda: main.main(["back-in", str(run_dir), "--lookout", "Bo"])) == 3
    assert "the aPad is inside the fence" in capsys.readouterr().out


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


def test_without_a_supervisor_the_command_says_what_can_be_done(
    run_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main.main(["stop", str(tmp_path)]) == 2
    assert "is no run: name the directory" in capsys.readouterr().err
    assert main.main(["stop", str(run_dir)]) == 2
    assert "no supervisor of" in capsys.readouterr().err
    # What a killed supervisor leaves.
    with socket.socket(socket.AF_UNIX) as left, monkeypatch.context() as there:
        there.chdir(run_dir)
        left.bind(SOCKET_NAME)
    assert main.main(["stop", str(run_dir)]) == 2
    assert f"continue with: musselbed resume {run_dir}" in capsys.readouterr().err
    (run_dir / "summary.json").write_text("{}")
    assert main.main(["stop", str(run_dir)]) == 2
    assert "it has ended" in capsys.readouterr().err


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


def test_a_go_to_takes_the_apad_over_and_moves_it_and_a_hold_follows(flying: Flying, run_dir: Path) -> None:
    flying.until(lambda: flying.phase is Phase.GO_COLLECT)
    order = Request(Act.GO_TO, "Anna", goal_m=(20.0, 15.0), speed_m_s=0.4)
    answer = flying.answered(lambda: ask(run_dir, order))
    assert answer.accepted and answer.steers.startswith("a person steers")
    assert flying.phase is Phase.COMMANDED
    assert [it["taken"] for it in flying.events("override")] == [True]
    flying.until(lambda: flying.calls.wait(0).goto is Status.DONE)
    here = flying.flight.supervisor.pose
    assert here is not None and math.dist((here.north_m, here.east_m), (20.0, 15.0)) < 1.0

    hold = Request(Act.HOLD, "Anna", goal_m=(18.0, 15.0))
    assert flying.answered(lambda: ask(run_dir, hold)).accepted
    assert flying.by_hand.state.phase is Phase.COMMANDED
    orders = [(it["order"], it["north_m"], it["east_m"]) for it in flying.events("operator")]
    assert orders == [("go to", 20.0, 15.0), ("hold", 18.0, 15.0)]

    assert flying.answered(lambda: ask(run_dir, Request(Act.GIVE_BACK, "Anna"))).accepted
    assert flying.phase is not Phase.COMMANDED


def test_a_go_to_replaces_the_one_that_was_stopped(flying: Flying, run_dir: Path) -> None:
    flying.until(lambda: flying.phase is Phase.GO_COLLECT)
    assert flying.answered(lambda: ask(run_dir, Request(Act.GO_TO, "Anna", goal_m=(20.0, 15.0)))).accepted
    flying.seconds(2)
    assert flying.answered(lambda: ask(run_dir, Request(Act.STOP, "Anna"))).accepted
    assert flying.calls.wait(0).paused
    assert flying.answered(lambda: ask(run_dir, Request(Act.GO_TO, "Anna", goal_m=(14.0, 5.0)))).accepted
    flying.until(lambda: flying.calls.wait(0).goto is Status.DONE)
    here = flying.flight.supervisor.pose
    assert here is not None and math.dist((here.north_m, here.east_m), (14.0, 5.0)) < 1.0
    # No stopped order is left to go on with.
    assert not flying.answered(lambda: ask(run_dir, Request(Act.CONTINUE, "Anna"))).accepted
    assert flying.answered(lambda: ask(run_dir, Request(Act.GIVE_BACK, "Anna"))).accepted
    assert flying.phase is not Phase.COMMANDED


@pytest.mark.parametrize(
    ("goal_m", "speed_m_s", "why"),
    [
        ((20.0, 40.0), None, "fence"),
        ((20.0, 15.0), 9.0, "max_speed_m_s"),
        ((1e6, 0.0), None, "from the scenario's origin"),
        (None, None, "needs a goal"),
    ],
)
@pytest.mark.parametrize("act", [Act.GO_TO, Act.HOLD])
def test_a_refused_go_to_leaves_the_mission_flying(
    pool: Scenario,
    run_dir: Path,
    act: Act,
    goal_m: tuple[float, float] | None,
    speed_m_s: float | None,
    why: str,
) -> None:
    fence = ((-4.0, -4.0), (32.0, -4.0), (32.0, 25.0), (-4.0, 25.0))
    flying = Flying(replace(pool, area=replace(pool.area, fence=fence)))
    flying.until(lambda: flying.phase is Phase.GO_COLLECT)
    with control_offered(run_dir, flying.calls, flying.gate):
        answer = flying.answered(
            lambda: ask(run_dir, Request(act, "Anna", goal_m=goal_m, speed_m_s=speed_m_s))
        )
    assert not answer.accepted and why in answer.message
    assert flying.phase is Phase.GO_COLLECT
    assert flying.events("override") == [] and flying.events("operator") == []
    assert [it["guard"] for it in flying.events("refused")] == (["fence"] if why == "fence" else [])


def test_a_flight_s_speed_changes_by_a_person_and_a_stop_waits_while_time_stands(pool: Scenario) -> None:
    flying, speed = Flying(pool), FlightSpeed(20.0)
    flying.seconds(3)

    def asked(act: Act, times: float | None = None) -> Answer:
        return control_server.carry_out(
            Request(act, "Anna", times=times), flying.calls, flying.gate, speed=speed
        )

    answers = [flying.answered(lambda it=it: asked(Act.SPEED, it)) for it in (None, 5.0, 0.0)]  # type: ignore[misc]
    assert [it.accepted for it in answers] == [False, True, True]
    assert "a step takes `musselbed speed RUN 0` first" in answers[0].message
    assert speed.stands and not speed.lets_pass(1000)
    # Without a tick: only a stop is kept for the next one.
    refused, stopped = asked(Act.ABORT), asked(Act.STOP)
    assert not refused.accepted and "mission time stands still" in refused.message
    assert not stopped.accepted and "goes out with the next tick" in stopped.message
    assert flying.answered(lambda: asked(Act.SPEED)).accepted
    assert flying.phase is Phase.COMMANDED
    assert [speed.lets_pass(it) for it in (500, 1000, 1500)] == [True, True, False]
    assert flying.answered(lambda: asked(Act.SPEED, 2.0)).accepted
    assert speed.times == 2.0
    assert [it["times"] for it in flying.events("speed")] == [5.0, 0.0, 0.0, 2.0]


def test_a_time_that_is_not_the_flight_s_own_has_no_speed(flying: Flying, run_dir: Path) -> None:
    answer = control_server.carry_out(Request(Act.SPEED, "Anna", times=5.0), flying.calls, flying.gate)
    assert not answer.accepted
    assert "to stop the aPad: musselbed stop RUN" in answer.message
    assert "0.01 to 10000" in Request(Act.SPEED, "Anna", times=-1.0).mistake
    assert "0.01 to 10000" in Request(Act.SPEED, "Anna", times=math.inf).mistake
