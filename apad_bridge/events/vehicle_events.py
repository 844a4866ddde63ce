"""Events that the aPad's own messages tell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from apad_bridge.events.event import AMussel, Category, East, Event, Meaning, North, Uncounted


@dataclass(frozen=True)
class APadMoved(Event):
    kind = "apad"
    when = "the aPad moved, turned, used energy or changed its docks, or a minute passed"
    counted = Uncounted("a sample of the vehicle's motion; its orders, docks and failures count")

    north_m: North
    east_m: East
    heading_rad: Annotated[float, Meaning("heading, from north to east", "rad")]
    voltage_v: Annotated[float | None, Meaning("its battery's voltage", "V")]
    battery: Annotated[float | None, Meaning("charge of its battery", "0 to 1")]
    primitive: Annotated[str, Meaning("the primitive under way, or `none`")]
    docks: Annotated[list[int], Meaning("the aMussel in each dock, -1 for none")]


@dataclass(frozen=True)
class DocksDisagree(Event):
    kind = "docks_disagree"
    when = "witnesses of a dock disagree: `position_static`, `check_docking_availability`, the aMussel, our own record"
    counted = ("id", "reason")
    category = Category.ALARM

    id: AMussel
    reason: Annotated[str, Meaning("what each says, and what the mission takes for true")]

    def text(self) -> str:
        return f"the docks' witnesses disagree about aMussel {self.id}: {self.reason}"


@dataclass(frozen=True)
class VehicleSilent(Event):
    kind = "vehicle_silent"
    when = "a real aPad stopped publishing"
    counted = Uncounted("the machine's network, by the wall clock")
    category = Category.TROUBLE

    name: Annotated[str, Meaning("the aPad")]
    since_ms: Annotated[int, Meaning("since when", "mission ms")]

    def text(self) -> str:
        return "the aPad is silent"


@dataclass(frozen=True)
class VehicleHeard(Event):
    kind = "vehicle_heard"
    when = "it publishes again"
    counted = Uncounted("the machine's network, by the wall clock")
    category = Category.RELIEF

    name: Annotated[str, Meaning("the aPad")]
    since_ms: Annotated[int, Meaning("since when it was silent", "mission ms")]

    def text(self) -> str:
        return "the aPad publishes again"
