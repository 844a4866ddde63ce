"""What an aPad of generation B says, as facts; what the port commands, as orders. No ROS in here, and no clock.

That stack answers at once and tells the end by topics that name no order; nothing in it has a time-out; and every end
leaves the controllers off. What was told to it and how that goes is made out by `generation_b_tasks`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from apad_bridge.scenario.lab_interface.messages import DockSaid
from apad_bridge.scenario.schema import Docking
from apad_bridge.vehicle.commands import VehicleCommand
from apad_bridge.vehicle.generation_b.docks import DocksByBench
from apad_bridge.vehicle.generation_b.messages import (
    Answered,
    ArmHeard,
    Call,
    FinishedHeard,
    Heard,
    PilotHeard,
    StatusHeard,
)
from apad_bridge.vehicle.generation_b.tasks import Tasks
from apad_bridge.vehicle.link import LinkFact
from apad_bridge.vehicle.simulated.misses import Misses
from apad_bridge.vehicle.stack_messages import BatteryHeard, PoseHeard, StateHeard
from apad_bridge.vehicle.telemetry import InTime, Readings, Sight, SilenceWatch


class GenerationBCore:
    """`hear` takes what came, `command` what the port says, `advance` gives the facts stamped up to its time.

    `take_calls` gives what is to be sent to the vehicle's services. `battery_v` is (empty, full); `docked` are agents by
    slot known to be held at `now_ms`; `sight` says where simulated aMussels float, `misses` which dockings fail.
    """

    def __init__(
        self,
        agent_ids: Iterable[int],
        battery_v: tuple[float, float],
        docking: Docking,
        misses: Misses,
        sight: Sight = lambda now_ms: {},
        docked: Mapping[int, int] | None = None,
        now_ms: int = 0,
    ) -> None:
        self.readings = Readings(battery_v)
        self.docks = DocksByBench(agent_ids, docked or {}, misses, sight)
        self.status_words = 0
        """How many words were heard of either status."""
        self._tasks = Tasks(docking, self.docks, self.readings)
        self._in_time: InTime[Heard] = InTime(now_ms)
        self._silence = SilenceWatch()

    @property
    def dropped(self) -> Counter[str]:
        """Words of the vehicle that were of no use, by reason."""
        return self.readings.dropped + self.docks.dropped + self._tasks.dropped

    @property
    def untaken(self) -> list[str]:
        """The order that counts, while its service has not answered."""
        return self._tasks.calls.unanswered

    def unheard(self, now_ms: int) -> list[str]:
        return ["position"] if self.readings.position_ms < now_ms else []

    def take_calls(self) -> list[Call]:
        return self._tasks.calls.take()

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        self._tasks.command(command, now_ms)

    def hear(self, heard: Heard, now_ms: int) -> None:
        """What is stamped after `now_ms` waits for its time."""
        if self._in_time.puts_off(heard, now_ms):
            return
        match heard:
            case PoseHeard() | StateHeard() | BatteryHeard():
                self.readings.hear(heard)
            case Answered():
                self._tasks.calls.hear(heard)
            case StatusHeard(at_ms, docking, status):
                self.status_words += 1
                self._tasks.hear_status(docking, status, at_ms)
            case PilotHeard(at_ms, steers):
                self._tasks.hear_pilot(steers, at_ms)
            case ArmHeard(at_ms, dock_index) if dock_index is not None:
                self._tasks.hear_arm(dock_index, at_ms)
            case ArmHeard() | FinishedHeard():
                pass  # a closed arm, or some primitive's end: the statuses tell what came of it

    def hear_dock(self, word: DockSaid) -> None:
        """Somebody says what a dock did. By id; of none, by slot and place. What is known already is no news."""
        self._tasks.hear_dock(word)

    def advance(self, now_ms: int) -> list[LinkFact]:
        """Facts not told before, each stamped at or before `now_ms`; poses and places are the newest only."""
        for heard in self._in_time.advance(now_ms):
            self.hear(heard, now_ms)
        if not self._tasks.pilot_steers:
            changed = self._silence.look(self.readings.position_ms, now_ms)
            if changed is not None and not changed.is_silent:
                self._tasks.tell_again(now_ms)
            self._tasks.watch(now_ms)
        return [*self._tasks.take(), *self.docks.places(self.readings.pose, now_ms), *self.readings.take()]
