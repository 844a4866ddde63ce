"""Events of aMussels, their processes and their faults, and of the fleet's division among several aPads."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from annotated_types import Ge, Lt

from apad_bridge.beliefs.modes import Mode, mode_of
from apad_bridge.events.event import (
    AgentTime,
    AMussel,
    Category,
    East,
    Event,
    Meaning,
    North,
    Reason,
    Uncounted,
)
from apad_bridge.scenario.timed_faults import TimedFault
from firmware_model.actions import Buoyancy
from firmware_model.power.charge import Flow
from firmware_model.states import State

BatteryAnchor = tuple[int, int, Annotated[int, Ge(0), Lt(len(Flow))], int, int]
"""Anchor, charge, flow, load, coils: agent ms, grains."""


class Presence(StrEnum):
    SIMULATED = "simulated"
    REAL = "real"
    RETIRED = "retired"


@dataclass(frozen=True)
class TruthChanged(Event):
    kind = "truth"
    when = "a simulated aMussel's true state changed, or it drifted by a quarter of a metre; it holds until the next"
    counted = ("id", "agent_ms", "state", "docked", "north_um", "east_um", "primary", "secondary")

    id: AMussel
    agent_ms: AgentTime
    state: Annotated[State, Meaning("the board's state, by name")]
    primary: Annotated[
        BatteryAnchor, Meaning("battery: anchor, charge, flow, load, coils", "agent ms, grains")
    ]
    secondary: Annotated[BatteryAnchor, Meaning("the other battery, in the same form", "agent ms, grains")]
    north_um: Annotated[int, Meaning("place, north", "um")]
    east_um: Annotated[int, Meaning("place, east", "um")]
    depth: Annotated[tuple[int, int], Meaning("anchor, and the depth then", "agent ms, um")]
    buoyancy: Annotated[Buoyancy, Meaning("the direction in which its motors move it")]
    docked: Annotated[bool, Meaning("true while a dock holds it")]
    hover_um: Annotated[int | None, Meaning("the depth to which it hovers", "um")] = None
    pin_due: Annotated[int | None, Meaning("when the coils will be aligned", "agent ms")] = None
    log: Annotated[tuple[int, int] | None, Meaning("samples taken, and samples acknowledged")] = None


@dataclass(frozen=True)
class BeliefChanged(Event):
    kind = "belief"
    when = "the supervisor's belief of an aMussel changed noticeably"
    counted = Uncounted("an estimate; the plans and orders that follow from it count")

    id: AMussel
    heard: Annotated[int, Meaning("the time of its newest packet", "mission ms")]
    state: Annotated[State, Meaning("the board's state, by name")]
    charge: Annotated[float, Meaning("of the primary battery", "0 to 1")]
    secondary: Annotated[float, Meaning("charge of the other battery", "0 to 1")]
    north_m: North
    east_m: East
    sd: Annotated[float | None, Meaning("standard deviation of the charge; of a twin alone", "0 to 1")] = None
    low: Annotated[float | None, Meaning("begin of the charge's interval of 95 %", "0 to 1")] = None
    high: Annotated[float | None, Meaning("end of that interval", "0 to 1")] = None
    mode: Annotated[Mode | None, Meaning("the most probable mode, by name")] = None
    place_cov: Annotated[
        tuple[float, float, float] | None,
        Meaning("its place's variance north, covariance, and variance east; of a twin alone", "m2"),
    ] = None
    reported: Annotated[
        dict[str, float] | None,
        Meaning("by name, what else is known of it: the newest of the quantities that it reports"),
    ] = None

    @property
    def likely_mode(self) -> Mode:
        """The most probable mode: that of the state where no twin gives one."""
        return mode_of(self.state, self.charge, self.secondary) if self.mode is None else self.mode


@dataclass(frozen=True)
class CapacityLearned(Event):
    kind = "capacity"
    when = "a twin knows better, by a hundredth, how much of its capacity an aMussel's batteries have left"
    counted = Uncounted("an estimate; the plans and orders that follow from it count")

    id: AMussel
    low: Annotated[float, Meaning("begin of the interval of 95 % of the share that is left", "0 to 1")]
    high: Annotated[float, Meaning("end of that interval", "0 to 1")]


@dataclass(frozen=True)
class Stimulated(Event):
    kind = "stimulus"
    when = "something reached an aMussel: a contact, a packet, its place in a dock"
    counted = Uncounted("the form of a message between processes; the aMussel's new state counts")
    is_for_journal_alone = True

    id: AMussel
    agent_ms: AgentTime
    wire: Annotated[
        list[int | str],
        Meaning("its number in `agents/mussel/stimuli.py` and its fields; bytes in hexadecimal"),
    ]


@dataclass(frozen=True)
class ProcessDied(Event):
    kind = "died"
    when = "an aMussel's process ended: a reset of its MU"
    counted = ("id", "agent_ms", "cause")
    category = Category.TROUBLE
    is_shown_at_once = True

    id: AMussel
    agent_ms: AgentTime
    cause: Annotated[str, Meaning("the cause of the reset, by name")]
    reason: Annotated[str, Meaning("why the process ended")]
    gave_up: Annotated[str | None, Meaning("why it stays dead; null when it was started again")]

    def text(self) -> str:
        if self.gave_up is not None:
            return f"the process of aMussel {self.id} died for good: {self.gave_up}"
        return f"the process of aMussel {self.id} died ({self.reason}), and was started again"


@dataclass(frozen=True)
class StateDisbelieved(Event):
    kind = "state_doubted"
    when = "firmware of somebody's own tells a state that its board contradicts, for the first time"
    counted = Uncounted("a warning; the orders that follow from the state count")
    category = Category.ALARM

    id: AMussel
    reason: Reason

    def text(self) -> str:
        return f"the firmware of aMussel {self.id} is wrong: {self.reason}"


@dataclass(frozen=True)
class AMusselSuspected(Event):
    kind = "suspect"
    when = "packets of an aMussel contradict physics, for the first time: its twin believes no charge that they state"
    counted = Uncounted("an estimate; the orders that follow from it count")
    category = Category.ALARM

    id: AMussel
    reason: Reason

    def text(self) -> str:
        return f"aMussel {self.id} is suspect: {self.reason}"


@dataclass(frozen=True)
class SuspicionOver(Event):
    kind = "suspect_over"
    when = "the reading of a suspect aMussel that stood moves again: its twin believes it as any board's"
    counted = Uncounted("an estimate; the orders that follow from it count")
    category = Category.RELIEF

    id: AMussel

    def text(self) -> str:
        return f"aMussel {self.id} is no longer suspect: its reading moves again"


@dataclass(frozen=True)
class APadLeftWater(Event):
    kind = "left_water"
    when = "an aPad's modem and its aMussels are out of the water that several aPads share, before its mission's end"
    counted = ("name",)
    category = Category.ALARM

    name: Annotated[str, Meaning("the aPad")]
    reason: Reason

    def text(self) -> str:
        return f"{self.name} is out of the water: {self.reason}"


@dataclass(frozen=True)
class PresenceChanged(Event):
    kind = "presence"
    when = "an aMussel became real, retired, or simulated again"
    counted = ("id", "is")
    category = Category.PLAN

    id: AMussel
    is_: Annotated[Presence, Meaning("its new presence")]
    by: Annotated[str, Meaning("the node that asked")]

    def text(self) -> str:
        return f"aMussel {self.id} is {self.is_}"


@dataclass(frozen=True, kw_only=True)
class FaultBegan(Event):
    kind = "fault"
    when = "a fault began, of a simulated aMussel or of the simulated aPad ([faults.md](faults.md))"
    counted = ("id", "fault", "until_ms")
    category = Category.TROUBLE

    id: Annotated[int | None, Meaning("the aMussel; absent for a fault of the aPad")] = None
    fault: Annotated[TimedFault, Meaning("which")]
    value: Annotated[float | None, Meaning("its value, in the unit of its row")] = None
    until_ms: Annotated[
        int | None, Meaning("when it ends; the line's own time for one that is over at once", "ms")
    ] = None
    refused: Annotated[str | None, Meaning("why a fault of the scenario did not begin")] = None

    def text(self) -> str:
        if self.refused is not None:
            return f"fault of {_whose(self.id)} did not begin: {self.fault}, {self.refused}"
        value = "" if self.value is None else f", {self.value:g}"
        return f"fault of {_whose(self.id)}: {self.fault}{value}"


@dataclass(frozen=True, kw_only=True)
class FaultEnded(Event):
    kind = "fault_over"
    when = "a fault that lasted was healed"
    counted = ("id", "fault")
    category = Category.RELIEF

    id: Annotated[int | None, Meaning("the aMussel; absent for a fault of the aPad")] = None
    fault: Annotated[TimedFault, Meaning("which")]

    def text(self) -> str:
        return f"fault of {_whose(self.id)} healed: {self.fault}"


@dataclass(frozen=True)
class HandedOn(Event):
    kind = "handed_on"
    when = "one of several aPads no longer serves an aMussel"
    counted = ("id", "to")

    id: AMussel
    to: Annotated[str | None, Meaning("the aPad that does; with --time asap")] = None


@dataclass(frozen=True)
class TookOn(Event):
    kind = "took_on"
    when = "one of several aPads serves another aMussel"
    counted = ("id", "of")

    id: AMussel
    of_: Annotated[str | None, Meaning("the aPad that did; with --time asap")] = None


def _whose(agent_id: int | None) -> str:
    return "the aPad" if agent_id is None else f"aMussel {agent_id}"
