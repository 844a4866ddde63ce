"""The aPad's API for mission scripts (paper, section III and Listing 1).

The API knows beliefs, never the truth. A point `[lat, lon]` is in degrees, a name that ends in `_m` is in metres, times
are seconds of mission time, and docks are numbered from 1.

A call that cannot be done raises `Refused` with a message of one line, and changes nothing. A call about an aMussel that
has not reported yet waits for its first packet, at most for the scenario's `silence_timeout_s`; every other wait has a
timeout too. After the mission's end (its time is over, the aPad's battery, a person, `abort`), the script's next call
ends the script.
"""

from __future__ import annotations

import json
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

from apad_bridge.beliefs.input_ranges import FARTHEST_M
from apad_bridge.events.mission_events import MissionEnd
from apad_bridge.events.person_events import ScriptReported
from apad_bridge.events.run_events import EndReason
from apad_bridge.mission.manual import ManualMission
from apad_bridge.mission.script_values import (
    Refused,
    ScriptEvent,
    Status,
    dock_index_of,
    dock_of,
    manoeuvre_of,
)
from apad_bridge.planning.costs import CostBreakdown
from apad_bridge.scripting import planned
from apad_bridge.scripting.planned import Plan
from apad_bridge.scripting.queries import FOR_EVER_S, Flag, Point, Queries, checks_arguments
from apad_bridge.scripting.rendezvous import Wait
from apad_bridge.vehicle.commands import Manoeuvre
from firmware_model.packets import Kind

_OWN_FIELDS = frozenset({"t", "at_ms", "kind", "what", "said"})
"""Fields of an event that the journal names itself."""


class Behaviour:
    """A base class for behaviours: derive from it, define `tick`, and give an instance to `api.run`.

    A behaviour keeps its state in its own attributes, so that it can be run again or inside another behaviour.
    """

    def begin(self, api: Api) -> None:
        """Prepares the behaviour; called once, before the first tick."""

    def tick(self, api: Api) -> bool:
        """Acts; called once a mission second. Return True when the behaviour is done.

        It may also sleep and wait; the next tick comes after that.
        """
        raise NotImplementedError

    def event(self, api: Api, event: ScriptEvent) -> None:
        """Handles an event; called for each event since the last tick, in order."""


@checks_arguments
class Api(Queries):
    """A script's access to the mission: its variable `api`.

    A point `[lat, lon]` is in degrees, a name that ends in `_m` is in metres, times are seconds of mission time, and docks
    are numbered from 1. A call that cannot be done raises `Refused` and changes nothing.
    """

    if not TYPE_CHECKING:  # a checker of types finds a wrong call before the flight

        def __getattr__(self, name: str) -> Any:
            """Refuses a call that does not exist, with the name of the nearest one."""
            calls = [it for it in dir(type(self)) if not it.startswith("_")]
            near = get_close_matches(name, calls, n=1)
            meant = f"did you mean api.{near[0]}? " if near else ""
            raise AttributeError(f"there is no api.{name}: {meant}docs/reference/api.md has every call")

    # Primitives: each call gives an order and returns at once.

    def go_to(self, point: Point, speed: float | None = None, victory_radius: float | None = None) -> None:
        """Sends the aPad to `[lat, lon]` in degrees.

        `speed` (m/s) and `victory_radius` (m) default to the scenario's.
        """
        latitude, longitude = point
        self.go_to_local(*self._frame.to_local(latitude, longitude), speed, victory_radius)

    def go_to_local(
        self, north_m: float, east_m: float, speed: float | None = None, victory_radius: float | None = None
    ) -> None:
        """Sends the aPad to a point in metres north and east of the scenario's origin; otherwise as `go_to`."""
        if not abs(north_m) + abs(east_m) < FARTHEST_M:
            raise Refused(
                f"the goal lies {abs(north_m) + abs(east_m):.0f} m from the scenario's origin: go_to takes [latitude, "
                "longitude] in degrees, go_to_local metres"
            )
        self._do(lambda mission: mission.go_to(north_m, east_m, speed, victory_radius))

    def goto_status(self, id: str | None = None) -> Status:
        """The last go-to's status: 0 idle, 1 running, 2 pre-empted, 3 done, 4 failed."""
        self._refuse_others(id)
        return self._do(lambda mission: mission.goto)

    def hold(self, point: Point | None = None) -> None:
        """Holds the position at `[lat, lon]`, or where the aPad is; pre-empts the primitive under way."""
        place = (None, None) if point is None else self._frame.to_local(*point)
        self._do(lambda mission: mission.hold(*place))

    def docking(
        self,
        dock: Flag,
        number: int,
        id: int | None = None,
        yaw_rate: float | None = None,
        surge_speed: float | None = None,
    ) -> None:
        """Docks or undocks an aMussel.

        With `dock` True: lets aMussel `id` surface if it is not at the surface, and takes it into dock `number`.
        With `dock` False: releases the aMussel that is in dock `number`.

        `yaw_rate` (rad/s) and `surge_speed` (m/s) replace the scenario's for an aPad that docks by visual servoing.
        """
        dock_index, manoeuvre = self._dock_index_of(number), manoeuvre_of(yaw_rate, surge_speed)
        if not dock:
            self._do(lambda mission: self._undock(mission, dock_index, id, manoeuvre))
            return
        if id is None:
            raise Refused("docking(True, ...) needs the aMussel's id")
        self._await_first_packet(id)
        self._do(lambda mission: mission.dock(dock_index, id, manoeuvre))

    def docking_status(self, id: str | None = None) -> Status:
        """The status of the last docking or undocking, with the numbers of `goto_status`."""
        self._refuse_others(id)
        return self._do(lambda mission: mission.docking)

    def permit_surfacing(self, id: int) -> None:
        """Permits an aMussel by sound to surface, once. `docking` does so too, and repeats it until the aMussel obeys."""
        self._await_first_packet(id)
        self._do(lambda mission: mission.permit_surfacing(id))

    def tell_clear(self, id: int) -> None:
        """Tells a floating aMussel by Wi-Fi that it may sink. An undocking does so by itself."""
        self._do(lambda mission: mission.send_command(Kind.RELEASE, id))

    @property
    def failure(self) -> str | None:
        """The reason of the last failure of a primitive; None if none has failed."""
        return self._do(lambda mission: mission.failure)

    # Waiting for primitives.

    def wait_goto(self, timeout: float = 3600.0) -> Status:
        """Waits until the go-to is no longer running and returns its status: RUNNING after the timeout."""
        self.wait_until(lambda: self.goto_status() is not Status.RUNNING, timeout)
        return self.goto_status()

    def wait_docking(self, timeout: float = 3600.0) -> Status:
        """Waits until the docking or undocking is no longer running, as `wait_goto` does."""
        self.wait_until(lambda: self.docking_status() is not Status.RUNNING, timeout)
        return self.docking_status()

    def collect(self, id: int, dock: int, timeout: float = 3600.0) -> bool:
        """Goes to an aMussel, letting it surface on the way, and docks it. True if it is in the dock at the end."""
        self._dock_index_of(dock)  # A wrong dock is refused now, and not after the go-to.
        until_s = self.now() + timeout
        self._await_first_packet(id)
        self.go_to_local(*self._place_of(id))
        self._do(lambda mission: mission.call_up(id))
        if self.wait_goto(timeout) is not Status.DONE:
            return False
        self.docking(True, dock, id)
        return self.wait_docking(max(0.0, until_s - self.now())) is Status.DONE

    def deploy(self, id: int, timeout: float = 3600.0) -> bool:
        """Takes a docked aMussel to its home and undocks it. True if it was undocked there."""
        until_s = self.now() + timeout
        dock = next((dock for dock, agent in self.docks().items() if agent == id), None)
        if dock is None:
            raise Refused(f"aMussel {id} is in no dock")
        home = self.home(id)
        self.go_to_local(home.north_m, home.east_m)
        if self.wait_goto(timeout) is not Status.DONE:
            return False
        self.docking(False, dock, id)
        return self.wait_docking(max(0.0, until_s - self.now())) is Status.DONE

    # Events.

    def events(self, kind: str | None = None, agent: int | None = None) -> list[ScriptEvent]:
        """The events since the last call (see `ScriptEvent`), oldest first; of one kind or one aMussel alone, if given."""
        return self._do(lambda mission: mission.events.take(kind, agent))

    def wait_event(
        self, kind: str | None = None, agent: int | None = None, timeout: float = 60.0
    ) -> ScriptEvent | None:
        """The oldest such event; waits if there is none yet. None after the timeout."""
        found: list[ScriptEvent] = []

        def look() -> bool:
            event = self._do(lambda mission: mission.events.take_first(kind, agent))
            if event is not None:
                found.append(event)
            return event is not None

        return found[0] if look() or self.wait_until(look, timeout) else None

    # The mission as a whole.

    def pause(self) -> None:
        """Pauses the mission: the aPad holds its position, and `resume` continues a go-to."""
        self._do(lambda mission: mission.pause())

    def resume(self) -> None:
        """Continues after `pause`; does nothing if the mission is not paused."""
        self._do(lambda mission: mission.resume())

    def abort(self, reason: str = "the script") -> None:
        """Ends the mission and the script at this call; the aPad holds its position."""
        self._do(lambda mission: mission.finish(MissionEnd(EndReason.SCRIPT_ABORTED, reason)))
        self._rendezvous.request(Wait(None, self._until_ms(FOR_EVER_S)))

    def note(self, kind: str, **data: object) -> None:
        """Writes an event of your own into the run's journal and bag; plain data only."""
        if taken := sorted(_OWN_FIELDS & data.keys()):
            raise Refused(f"note: the journal has fields of these names itself: {', '.join(taken)}")
        try:
            json.dumps(data, allow_nan=False)
        except (TypeError, ValueError) as error:
            raise Refused(f"note: only plain data can be written into the journal: {error}") from None
        self._do(lambda mission: mission.emit(ScriptReported(what=kind, own=data)))

    def say(self, text: str) -> None:
        """Shows a text to the person who watches the flight, and writes it into the journal. `print` does the same."""

        def show_lines(mission: ManualMission) -> None:
            for line in text.splitlines():
                mission.emit(ScriptReported(line))
                self._print(line)

        self._do(show_lines)

    def run(self, behaviour: Behaviour, timeout: float = FOR_EVER_S) -> bool:
        """Calls a behaviour's `tick` once a second until it is done. True if it was done in time."""
        until_s = self.now() + timeout
        behaviour.begin(self)
        while not behaviour.tick(self):
            if self.now() >= until_s:
                return False
            self.sleep(1.0)
            for event in self.events():
                behaviour.event(self, event)
        return True

    # Plans and costs.

    def plan_collection(self, batch: int | None = None, strategy: str | None = None) -> Plan:
        """Plans which aMussels to collect into which docks.

        `batch` (how many) and `strategy` (its name) default to the scenario's.
        """
        return self._do(lambda mission: planned.collection(mission, self._pool, batch, strategy))

    def plan_redeployment(self, strategy: str | None = None) -> Plan:
        """Plans in which order to redeploy the docked aMussels, by the scenario's strategy unless another is named."""
        return self._do(lambda mission: planned.redeployment(mission, strategy))

    def cost_of(self, plan: Plan) -> CostBreakdown:
        """A plan's cost, from the aPad's place when it was made.

        Distance in metres, demand in whole batteries, and both with the scenario's factors.
        """
        return self._do(lambda mission: planned.cost(mission, plan))

    def cost(self) -> float:
        """The way that the aPad has driven on go-tos so far, in metres."""
        return self._do(lambda mission: mission.state.cost_m)

    def _dock_index_of(self, number: int) -> int:
        return self._do(lambda mission: dock_index_of(number, mission.state.dock_count))

    def _undock(self, mission: ManualMission, dock_index: int, id: int | None, manoeuvre: Manoeuvre) -> None:
        holder = mission.docks[dock_index]
        if id is not None and holder is not None and holder != id:
            raise Refused(f"dock {dock_of(dock_index)} holds aMussel {holder}, not {id}")
        mission.undock(dock_index, manoeuvre)

    def _place_of(self, id: int) -> tuple[float, float]:
        location = self.get_location(id)
        return location.north_m, location.east_m

    def _refuse_others(self, id: str | None) -> None:
        if id is not None and id != self.id_self:
            raise Refused(f"{id!r} is not this aPad, which is called {self.id_self!r}")
