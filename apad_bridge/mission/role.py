"""The supervisor's interface to a mission: the paper's, a script's, or one that follows a person's calls."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from agents.time_scale import MissionMs
from apad_bridge.events.mission import MissionEnd, MissionState
from apad_bridge.events.persons import Steering
from apad_bridge.mission.orders import MissionAction
from apad_bridge.vehicle.outcomes import Outcome


class MissionRole(Protocol):
    """Acts at mission ticks. `state` is one frozen value, journaled in every note of kind `mission`."""

    @property
    def state(self) -> MissionState: ...

    @property
    def docks(self) -> tuple[int | None, ...]:
        """The agent in each dock, None for a free one."""

    @property
    def unheard(self) -> str:
        """The word for what is needed of the aPad before anything is done, and was not heard yet; empty for nothing."""

    def moved(self, north_m: float, east_m: float) -> None:
        """Takes the aPad's position, in local NED metres."""

    def battery_heard(self, fraction: float) -> None:
        """Takes the aPad's battery, as a part of a full one."""

    def docks_named(self, named: Mapping[int, bool]) -> None:
        """Takes the word of the vehicle's service about its docks: whether it names each aMussel reported in one."""

    def await_person(self, reason: str, pilot: str = "") -> None:
        """From now on no order moves the aPad before a person allows it, for this reason; empty: orders may.

        `pilot` is the reason why none does for a pilot's sake.
        """

    def receive(self, outcome: Outcome, now_ms: MissionMs) -> list[MissionAction]: ...

    def advance(self, now_ms: MissionMs) -> list[MissionAction]: ...

    def stand_down(self, reason: str, now_ms: MissionMs) -> list[MissionAction]:
        """One of several aPads can do no more: it plans nothing, goes nowhere and keeps its docked aMussels.

        A second call changes nothing, and neither does any call to a mission that follows somebody's orders.
        """

    def take_over(self, by: Steering = Steering.PERSON) -> str:
        """Somebody else commands the aPad from now on, and nobody plans. The text is empty, or why nothing changed."""

    def end(self, end: MissionEnd, now_ms: MissionMs) -> list[MissionAction]:
        """Ends the mission at once; a second call changes nothing."""
