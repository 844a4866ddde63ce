"""The link to a vehicle that freezes, lies about its position, or whose docks jam. Everything else passes as it is."""

from __future__ import annotations

from dataclasses import replace

from apad_bridge.scenario.timed_faults import Injection, TimedFault
from apad_bridge.vehicle.commands import CloseDock, CommandFailed, OpenDock, PoseReported, VehicleCommand
from apad_bridge.vehicle.vehicle_link import APadSeen, Carried, Cleared, LetGo, LinkFact, VehicleLink


class FaultyLink:
    """A VehicleLink in front of another one. Contacts of aMussels are the world's: they pass a frozen vehicle, too."""

    def __init__(self, link: VehicleLink) -> None:
        self._link = link
        self.is_frozen = False
        """The vehicle reports nothing and takes no order; both come when it is no longer frozen."""
        self.north_error_m = 0.0
        """The reported place lies so far north of the true one."""
        self.jammed_docks: frozenset[int] = frozenset()
        self._facts: list[LinkFact] = []
        self._commands: list[Cleared[VehicleCommand]] = []
        self.close = link.close

    def begin(self, injection: Injection) -> None:
        """Begins a fault of the aPad."""
        match injection.fault:
            case TimedFault.APAD_FROZEN:
                self.is_frozen = True
            case TimedFault.APAD_LIES:
                self.north_error_m = injection.value
            case TimedFault.DOCK_JAMMED:
                self.jammed_docks |= {int(injection.value)}

    def end(self, injection: Injection) -> None:
        match injection.fault:
            case TimedFault.APAD_FROZEN:
                self.is_frozen = False
            case TimedFault.APAD_LIES:
                self.north_error_m = 0.0
            case TimedFault.DOCK_JAMMED:
                self.jammed_docks -= {int(injection.value)}

    def advance(self, now_ms: int) -> list[LinkFact]:
        if not self.is_frozen and self._commands:
            commands, self._commands = self._commands, []
            for cleared in commands:
                self._pass_on(cleared, now_ms)
        facts = self._link.advance(now_ms)
        if self.north_error_m:
            facts = [self._shifted(it) for it in facts]
        if self.is_frozen:
            self._facts += [it for it in facts if not isinstance(it, Carried | LetGo | APadSeen)]
            return [it for it in facts if isinstance(it, Carried | LetGo | APadSeen)]
        if self._facts:
            facts, self._facts = [*self._facts, *facts], []
        return facts

    def _shifted(self, fact: LinkFact) -> LinkFact:
        if isinstance(fact, PoseReported):
            return replace(fact, north_m=fact.north_m + self.north_error_m)
        return fact

    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        if self.is_frozen:
            self._commands.append(cleared)
        else:
            self._pass_on(cleared, now_ms)

    def _pass_on(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        command = cleared.order
        if isinstance(command, CloseDock | OpenDock) and command.dock_index in self.jammed_docks:
            reason = f"dock {command.dock_index + 1} is jammed"
            self._facts.append(CommandFailed(now_ms, command.command_id, reason))
        else:
            self._link.command(cleared, now_ms)
