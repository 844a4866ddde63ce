"""The aPad's API for mission scripts (paper, section III and Listing 1).

Everything that is known here is believed, never the truth. Places are degrees where they come as `[lat, lon]`, metres where
a name ends in `_m`; times are seconds of mission time; docks count from 1. A call that cannot be done raises `Refused` with
one line, and nothing has changed. What is asked of an aMussel that was not heard yet waits for its first word, as long as
the scenario's `silence_timeout_s`; every other wait has a time-out as well. When the mission ends (its time is over, the
aPad's battery, a person, `abort`), whatever the script calls next ends the script.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

from apad_bridge.mission.manual import ManualMission
from apad_bridge.mission.values import Event, Refused, Status, dock_index_of, dock_of, manoeuvre_of
from apad_bridge.planning.costs import CostBreakdown
from apad_bridge.scenario.local_frame import FARTHEST_M
from apad_bridge.scripting import planned
from apad_bridge.scripting.arguments import looks_at_arguments
from apad_bridge.scripting.planned import Plan
from apad_bridge.scripting.queries import FOR_EVER_S, Queries
from apad_bridge.scripting.rendezvous import Wait
from apad_bridge.vehicle.commands import Manoeuvre


class Behaviour:
    """Derive from it and say what `tick` does. What a behaviour remembers is its own, so it can be run again or nested."""

    def begin(self, api: Api) -> None:
        """Before the first tick."""

    def tick(self, api: Api) -> bool:
        """Once a mission second; True when it is done. It may also sleep and wait, which takes as long as it takes."""
        raise NotImplementedError

    def event(self, api: Api, event: Event) -> None:
        """Each event since the tick before, in order."""


@looks_at_arguments
class Api(Queries):
    """What a script calls `api`."""

    # Primitives: each of these orders, and returns at once.

    def go_to(
        self, point: Sequence[float], speed: float | None = None, victory_radius: float | None = None
    ) -> None:
        """To `[lat, lon]` in degrees; speed in m/s and victory radius in m are the scenario's unless given."""
        latitude, longitude = point
        self.go_to_local(*self._frame.to_local(latitude, longitude), speed, victory_radius)

    def go_to_local(
        self, north_m: float, east_m: float, speed: float | None = None, victory_radius: float | None = None
    ) -> None:
        if not abs(north_m) + abs(east_m) < FARTHEST_M:
            raise Refused(
                f"the goal lies {abs(north_m) + abs(east_m):.0f} m from the scenario's origin: go_to takes [latitude, "
                "longitude] in degrees, go_to_local metres"
            )
        self._do(lambda mission: mission.go_to(north_m, east_m, speed, victory_radius))

    def goto_status(self, id: str | None = None) -> Status:
        """0 idle, 1 running, 2 pre-empted, 3 done, 4 failed."""
        self._refuse_others(id)
        return self._do(lambda mission: mission.goto)

    def hold(self, point: Sequence[float] | None = None) -> None:
        """Hold position at `[lat, lon]`, or here; what was under way is pre-empted."""
        place = (None, None) if point is None else self._frame.to_local(*point)
        self._do(lambda mission: mission.hold(*place))

    def docking(
        self,
        dock: bool,
        number: int,
        id: int | None = None,
        yaw_rate: float | None = None,
        surge_speed: float | None = None,
    ) -> None:
        """True: let aMussel `id` surface if it is not up, and take it into dock `number`. False: let go who is in it.

        Yaw rate (rad/s) and surge speed (m/s) are for an aPad that docks by its own eyes, instead of the scenario's.
        """
        dock_index, manoeuvre = dock_index_of(number), manoeuvre_of(yaw_rate, surge_speed)
        if not dock:
            self._do(lambda mission: self._undock(mission, dock_index, id, manoeuvre))
            return
        if id is None:
            raise Refused("docking(True, ...) needs the aMussel's id")
        self._hear(id)
        self._do(lambda mission: mission.dock(dock_index, id, manoeuvre))

    def docking_status(self, id: str | None = None) -> Status:
        """As `goto_status`, of the last docking or undocking."""
        self._refuse_others(id)
        return self._do(lambda mission: mission.docking)

    def permit_surfacing(self, id: int) -> None:
        """By sound, once. `docking` does this too, and again until the aMussel obeys."""
        self._hear(id)
        self._do(lambda mission: mission.permit_surfacing(id))

    def tell_clear(self, id: int) -> None:
        """By Wi-Fi: a floating aMussel may sink. An undocking says it by itself."""
        self._do(lambda mission: mission.tell_clear(id))

    @property
    def failure(self) -> str | None:
        """Why a primitive failed last."""
        return self._do(lambda mission: mission.failure)

    # Waiting for them.

    def wait_goto(self, timeout: float = 3600.0) -> Status:
        """Waits until the go-to is no longer running; RUNNING when that takes longer."""
        self.wait_until(lambda: self.goto_status() is not Status.RUNNING, timeout)
        return self.goto_status()

    def wait_docking(self, timeout: float = 3600.0) -> Status:
        self.wait_until(lambda: self.docking_status() is not Status.RUNNING, timeout)
        return self.docking_status()

    def collect(self, id: int, dock: int, timeout: float = 3600.0) -> bool:
        """Goes to an aMussel, letting it surface on the way, and docks it: whether it is in the dock at the end."""
        dock_index_of(dock)  # Refused now, and not when the way is flown.
        until_s = self.now() + timeout
        self.permit_surfacing(id)
        self.go_to_local(*self._place_of(id))
        if self.wait_goto(timeout) is not Status.DONE:
            return False
        self.docking(True, dock, id)
        return self.wait_docking(max(0.0, until_s - self.now())) is Status.DONE

    def deploy(self, id: int, timeout: float = 3600.0) -> bool:
        """Brings a docked aMussel home and lets it go: whether it was let go there."""
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

    def events(self, kind: str | None = None, agent: int | None = None) -> list[Event]:
        """What has happened since it was last asked for (see `Event`), oldest first."""
        return self._do(lambda mission: mission.events.take(kind, agent))

    def wait_event(
        self, kind: str | None = None, agent: int | None = None, timeout: float = 60.0
    ) -> Event | None:
        """The oldest such event, waiting for one if there is none; None when none came in time."""
        found: list[Event] = []

        def look() -> bool:
            event = self._do(lambda mission: mission.events.take_first(kind, agent))
            if event is not None:
                found.append(event)
            return event is not None

        return found[0] if look() or self.wait_until(look, timeout) else None

    # The mission as a whole.

    def pause(self) -> None:
        """The aPad holds its position; a go-to goes on with `resume`."""
        self._do(lambda mission: mission.pause())

    def resume(self) -> None:
        self._do(lambda mission: mission.resume())

    def abort(self, reason: str = "the script") -> None:
        """Ends mission and script here; the aPad holds its position."""
        self._do(lambda mission: mission.finish(reason))
        self._rendezvous.ask(Wait(None, self._until_ms(FOR_EVER_S)))

    def note(self, kind: str, **data: object) -> None:
        """An event of your own for the run's journal and bag; plain data only."""
        try:
            json.dumps(data)
        except (TypeError, ValueError) as error:
            raise Refused(f"note: only plain data can be written into the journal: {error}") from None
        self._do(lambda mission: mission.note("script", what=kind, **data))

    def say(self, text: str) -> None:
        """To whoever watches the flight, and into the journal; a script's `print` does this."""

        def told(mission: ManualMission) -> None:
            for line in text.splitlines():
                mission.note("script", said=line)
                self._tell(line)

        self._do(told)

    def run(self, behaviour: Behaviour, timeout: float = FOR_EVER_S) -> bool:
        """Lets a behaviour act at every tick until it is done: whether it was done in time."""
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
        """Whom to collect into which dock, by the scenario's strategy unless another is named."""
        return self._do(lambda mission: planned.collection(mission, self._pool, batch, strategy))

    def plan_redeployment(self, strategy: str | None = None) -> Plan:
        return self._do(lambda mission: planned.redeployment(mission, strategy))

    def cost_of(self, plan: Plan) -> CostBreakdown:
        """From where the aPad is: metres, demand in batteries, and both with the scenario's factors."""
        return self._do(lambda mission: planned.cost(mission, plan))

    def cost(self) -> float:
        """Metres of all go-tos so far, as the paper counts the way: straight from point to point."""
        return self._do(lambda mission: mission.state.cost_m)

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
