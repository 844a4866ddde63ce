"""A flight that a test moves tick by tick, with calls of other threads; and transcripts, by which stories are told."""

import json
import re
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any

from journals import facts_of

from agents.time_scale import MissionMs
from apad_bridge.events.guard_events import StopState
from apad_bridge.events.mission_events import MissionChanged, MissionState, Phase
from apad_bridge.mission.call_queue import CallQueue
from apad_bridge.mission.flight_mission import FlightMission
from apad_bridge.mission.manual import ManualMission
from apad_bridge.runs.in_memory import MemoryRecorder, open_flight
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.supervisor.loop import Flight
from apad_bridge.supervisor.run_spec import RunSpec
from apad_bridge.vehicle.guards.gate import Gate


def play(story: str, answer: Callable[[str], str]) -> None:
    """Does what a transcript says, and compares the answers.

    Each line has a move, and behind the bar its whole answer, in which "..." stands for any words. A line without a move
    goes on with the answer above.
    """
    for line in re.sub(r"\n *\|", "", story).strip().splitlines():
        move, _, expected = map(str.strip, line.partition("|"))
        given = answer(move)
        assert re.fullmatch(re.escape(expected).replace(r"\.\.\.", ".*"), given), f"{move} | {given}"


def journaled(state: MissionState) -> MissionState:
    """The state as the journal gives it back."""
    line = json.dumps(MissionChanged(state.phase, state).data)
    return MissionChanged.of(json.loads(line)).snapshot


class Flying:
    """A flight of the pool that the test moves tick by tick, and calls as a ROS service would."""

    def __init__(
        self,
        pool: Scenario,
        join: Callable[[FlightContext], FlightContext] = lambda context: context,
        **spec: Any,
    ) -> None:
        """The scenario's own mission, which the calls may take over. `join` changes the flight's context."""
        self.calls = CallQueue()
        self.flight: Flight
        self.records: MemoryRecorder
        self.flight, self.records = open_flight(pool, RunSpec(calls=self.calls, **spec), join)
        self.now_ms = -1000

    @classmethod
    def by_calls(
        cls, pool: Scenario, join: Callable[[FlightContext], FlightContext] = lambda context: context
    ) -> "Flying":
        """A flight by hand: no mission plans."""
        return cls(pool, join, command_sources=())

    def until(self, holds: Callable[[], bool], limit_s: int = 1200) -> None:
        last_ms = self.now_ms + 1000 * limit_s
        while not holds():
            self.now_ms += 1000
            assert self.now_ms <= last_ms, "it never came to that"
            self.flight.tick(MissionMs(self.now_ms))

    def seconds(self, count: int) -> None:
        until_ms = self.now_ms + 1000 * count
        self.until(lambda: self.now_ms >= until_ms)

    def call(self, act: Callable[[ManualMission], Any]) -> Any:
        return self.answered(lambda: self.calls.call(act, 30))

    def call_mission(self, act: Callable[[Any], None]) -> None:
        self.answered(lambda: self.calls.call_mission(act, 30))

    def answered(self, ask: Callable[[], Any]) -> Any:
        """The answer of another thread; an error of it is raised. Mission time passes only while it waits for a tick."""
        with ThreadPoolExecutor(1) as pool:
            waiting = pool.submit(ask)
            while not wait([waiting], 0.01).done:
                if self.is_asked:
                    self.seconds(1)
            return waiting.result()

    @property
    def is_asked(self) -> bool:
        """Another thread waits for a tick, or until the hull obeys a stop."""
        stop = self.gate.stops.in_force
        is_open = stop is not None and stop.state in (StopState.ORDERED, StopState.SENT, StopState.TAKEN)
        return bool(self.calls._calls) or (is_open and stop is not None and not stop.unobserved)

    @property
    def gate(self) -> Gate:
        """Judges every order to the vehicle."""
        return self.flight._vehicle.gate

    @property
    def by_hand(self) -> ManualMission:
        """The mission that follows calls; the flight was taken over."""
        mission = self.flight.supervisor.mission
        assert isinstance(mission, FlightMission) and mission.by_hand is not None
        return mission.by_hand

    @property
    def phase(self) -> Phase:
        return self.flight.supervisor.mission.state.phase

    def events(self, kind: str) -> list[dict[str, Any]]:
        return [data for _, name, data in facts_of(self.records) if name == kind]
