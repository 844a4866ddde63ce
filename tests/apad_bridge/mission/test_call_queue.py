"""Calls of other threads, run at a tick, answered, refused, or withdrawn when no tick comes; and what an aPad does by hand.

What is done by hand are transcripts: each line has what the test does, and behind the bar what the mission orders, tells or
answers. A clock time is a tick.
"""

import threading
from typing import Any

import pytest
from flying import play

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.hold_last import LastPacket
from apad_bridge.events.event import Event
from apad_bridge.events.mission_events import MissionEnd
from apad_bridge.events.run_events import EndReason
from apad_bridge.mission.call_queue import CallQueue
from apad_bridge.mission.manual import ManualMission
from apad_bridge.mission.orders import Order, PermitSurfacing, SendCommand
from apad_bridge.mission.script_values import Refused, Status
from apad_bridge.runs.in_memory import open_flight
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor.run_spec import RunSpec
from apad_bridge.vehicle.commands import CloseDock, GoTo, Hold, Manoeuvre, OpenDock, Primitive
from apad_bridge.vehicle.outcomes import (
    DockChanged,
    NothingCaught,
    PrimitiveFailed,
    PrimitiveSucceeded,
    after_report,
)
from firmware_model.states import State


def test_a_call_is_done_at_the_next_tick_by_the_flight_s_thread(pool: Scenario) -> None:
    command_source, told = CallQueue(), []
    flight, _ = open_flight(pool, RunSpec(command_sources=(), calls=command_source))

    def caller() -> None:
        told.append(
            command_source.call(lambda mission: (mission.go_to(14.0, 12.0), threading.current_thread())[1])
        )
        while command_source.wait(20).goto is Status.RUNNING:
            pass
        told.append(command_source.wait(20).goto)
        with pytest.raises(Refused, match="dock 1 is empty"):
            command_source.call(lambda mission: mission.undock(0))
        command_source.call(lambda mission: mission.finish(MissionEnd(EndReason.CALL, "enough")))

    thread = threading.Thread(target=caller, daemon=True)
    thread.start()
    assert str(flight.run()) == "enough"
    thread.join(60)
    assert told == [threading.current_thread(), Status.DONE]
    with pytest.raises(Refused, match="the mission is over: enough"):
        command_source.call(lambda mission: None)


def test_a_call_that_no_tick_answers_is_withdrawn(pool: Scenario) -> None:
    command_source, done = CallQueue(), []
    with pytest.raises(Refused, match="nothing was ordered"):
        command_source.call(lambda mission: done.append(1), timeout_s=0.01)
    assert not command_source.has_calls
    with pytest.raises(Refused, match="with the next tick"):
        command_source.call_mission(lambda mission: done.append(2), 0.01, stays=True)
    assert command_source.has_calls
    # A later tick runs the one that stays, and not the other one.
    open_flight(pool, RunSpec(command_sources=(), calls=command_source))[0].step()
    assert done == [2] and not command_source.has_calls


class ByHand:
    """A mission by hand at (0, 0), and a fleet of aMussel 7 alone, 1 m off."""

    estimator = LastPacket()

    def __init__(self, pool: Scenario) -> None:
        self.state, self.primary = State.ACTIVE, 0.5
        self.mission = ManualMission(pool.mission, pool.apad.max_speed_m_s, self, ())
        self.mission.moved(0.0, 0.0)
        self.orders: list[Primitive] = []
        """All primitives so far."""
        self.now_ms = 1000
        self.keep(self.mission.advance(1000))

    def get(self, agent_id: int) -> Belief | None:
        return self.all()[0] if agent_id == 7 else None

    def all(self) -> list[Belief]:
        return [Belief(7, 0, self.state, self.primary, 1.0, 1.0, 0.0)]

    def keep(self, actions: list[Any]) -> list[str]:
        """The words for what was ordered and told."""
        self.orders += [it for it in actions if isinstance(it, Primitive)]
        return [it for action in actions if (it := word(action))]

    def do(self, move: str) -> list[str]:
        name, *words = move.split()
        match name:
            case "heard":
                self.state = State[words[0]]
                self.primary = float(words[1]) if words[1:] else self.primary
            case "ok" | "miss" | "fail":
                of = self.orders[int(words[0])] if words[:1] and words[0].startswith("-") else self.orders[-1]
                return self.ends(of, name, " ".join(it for it in words if not it.startswith("-")))
            case "closes":
                self.changes(int(words[0]), 7, closed=True)
            case "tell":
                return [
                    f"{it.at_s:g} {it.kind} {it.agent} {it.dock} {it.reason}"
                    for it in self.mission.events.take()
                ]
            case "see":
                values = [
                    getattr(self.mission, it, None) or getattr(self.mission.state, it, None) for it in words
                ]
                return [str(getattr(it, "name", it)) for it in values]
            case "at" | "ticks":
                ticks = range(self.now_ms + 1000, 1000 * int(words[0]) + 1, 1000) if name == "ticks" else ()
                return [
                    f"{self.now_ms // 1000} {it}" if name == "ticks" else it
                    for self.now_ms in ticks or (round(1000 * float(words[0])),)
                    for it in self.keep(self.mission.advance(self.now_ms))
                ]
            case _:
                return self.calls(name, *words)
        return []

    def calls(self, name: str, *words: str) -> list[str]:
        """A person's or a script's call, with its refusal."""
        numbers: list[Any] = [float(it) if "." in it else int(it) for it in words]
        if name == "dock" and len(numbers) > 2:
            numbers[2:] = [Manoeuvre(*numbers[2:])]
        try:
            answer = getattr(self.mission, name)(*numbers)
        except Refused as refused:
            return [f"refused: {refused}"]
        return [*([] if answer is None else [str(answer)]), *self.keep(self.mission.take_orders())]

    def ends(self, of: Primitive, how: str, reason: str) -> list[str]:
        if how == "ok" and isinstance(of, CloseDock | OpenDock):
            self.changes(of.dock_index, of.agent_id, isinstance(of, CloseDock))
        if how == "fail":
            return self.keep(
                self.mission.receive(PrimitiveFailed(self.now_ms, of.command_id, reason), self.now_ms)
            )
        ended = PrimitiveSucceeded if how == "ok" else NothingCaught
        return self.keep(self.mission.receive(ended(self.now_ms, of.command_id), self.now_ms))

    def changes(self, dock_index: int, agent_id: int, closed: bool) -> None:
        docked = after_report(self.mission.state.docked, dock_index, agent_id, closed=closed)
        self.mission.receive(DockChanged(self.now_ms, dock_index, agent_id, closed, docked), self.now_ms)


def word(action: Order) -> str | None:
    """An order or event of a transcript; None for what it leaves out."""
    match action:
        case GoTo():
            return f"go {action.north_m:g},{action.east_m:g}"
        case Hold():
            return "hold"
        case CloseDock(manoeuvre=how):
            return f"dock {action.agent_id} in {action.dock_index} at {how.yaw_rate_rad_s}, {how.surge_m_s}"
        case OpenDock():
            return f"undock {action.agent_id}"
        case PermitSurfacing():
            return f"call {action.agent_id}"
        case SendCommand():
            return f"{action.kind.name.lower()} {action.agent_id}"
        case Event(kind="released" | "given_up"):
            return ": ".join((action.kind, *map(str, action.data.values())))
    return None


STORIES = {
    "the permission is repeated every 10 s, six times in all, and then the docking fails": """
        dock 2 7            | call 7
        ticks 120           | 11 call 7; 21 call 7; 31 call 7; 41 call 7; 51 call 7;
                            | 61 given_up: 7: dock: it does not answer the permission to surface
        see docking failure | FAILED; it does not answer the permission to surface
        tell                | 1 heard 7 None None; 1 low 7 None None;
                            | 61 docking 7 3 it does not answer the permission to surface
    """,
    "one that comes up is docked, by the manoeuvre that was asked for": """
        dock 0 7 0.2 0.1  | call 7
        at 1              |
        heard SURFACING   |
        at 50             |
        heard FLOATING    |
        at 51             | dock 7 in 0 at 0.2, 0.1
        ok                |
        see docking docks | DONE; (7, None, None, None)
    """,
    "one that does not come up is given up": """
        dock 0 7            | call 7
        heard SURFACING     |
        at 121              |
        see docking         | RUNNING
        at 121.001          | given_up: 7: dock: it does not come up
        see docking failure | FAILED; it does not come up
    """,
    "a person ends a search by a hold": """
        heard FLOATING     |
        dock 0 7           | dock 7 in 0 at None, None
        miss               | go 4,0
        hold               | hold; hold
        see docking        | PREEMPTED
        fail -3 pre-empted |
        at 2               |
    """,
    "a person ends a search by a pause": """
        heard FLOATING     |
        dock 0 7           | dock 7 in 0 at None, None
        miss               | go 4,0
        pause              | hold
        see docking        | PREEMPTED
        fail -2 pre-empted |
        at 2               |
    """,
    "a search by hand ends with the docking": """
        heard FLOATING |
        dock 0 7       | dock 7 in 0 at None, None
        miss           | go 4,0
        see docking    | RUNNING
        ok             | dock 7 in 0 at None, None
        ok             |
        see docking    | DONE
    """,
    # Of the ten seconds until the next permission four were over.
    "a pause is no part of the time that an aMussel has to come up": """
        dock 2 7   | call 7
        at 1       |
        at 5       |
        pause      |
        at 5       |
        at 500     |
        resume     | True
        at 505.999 |
        at 506     | call 7
    """,
    # Nothing was driven of the first.
    "what is heard of an older go-to changes nothing": """
        go_to 5.0 0.0        | go 5,0
        go_to 9.0 0.0        | go 9,0
        fail -2 pre-empted   |
        see goto goto_orders | RUNNING; 2
        see planned_m cost_m | 9.0; 0.0
        fail stalled         |
        see goto failure     | FAILED; stalled
    """,
    "one that was let go is told that it may sink, and a full one counts": """
        closes 1             |
        heard CHARGING 0.995 |
        undock 1             | undock 7
        ok                   | release 7; released: 7: True
        see services docking | 1; DONE
    """,
    "events are told once": """
        ticks 4            |
        tell               | 1 heard 7 None None; 1 low 7 None None
        heard ACTIVE 0.9   |
        at 5               |
        tell               |
        heard FLOATING 0.8 |
        at 6               |
        at 7               |
        tell               | 6 state 7 None FLOATING; 6 low 7 None None
        heard SINKING      |
        at 8               |
        tell               | 8 state 7 None SINKING
    """,
    "a lost one is not docked": """
        heard LOST |
        dock 0 7   | refused: aMussel 7 is lost: it can no longer surface
    """,
    "what changes nothing says so, and an id left out is asked for": """
        resume   | False
        pause    |
        resume   | True
        dock 1 0 | refused: aMussel 0 never reported: give the aMussel's id; it is 0 if left out
    """,
}


@pytest.mark.parametrize("story", STORIES.values(), ids=STORIES)
def test_by_hand(pool: Scenario, story: str) -> None:
    by_hand = ByHand(pool)
    play(story, lambda move: "; ".join(by_hand.do(move)))
