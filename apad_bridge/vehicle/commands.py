"""Commands, from a mission to the docking port and from the port to a vehicle, and the vehicle's facts.

A mission orders primitives of the port. The port gives the vehicle the same commands under numbers of its own: each try of
a mechanism has another one, and a place to hold may be the port's own. The giver of a command chooses its `command_id`,
and the answer repeats it.

Positions are local NED metres, headings radians clockwise from north, times integer ms of mission time.
Commands are imperatives, facts are past tense; every fact carries the mission time at which it became true.
A simulated aPad has the three verbs (`next_due_ms`, `advance`, `receive`); a ROS link queues the same facts.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class GoTo:
    """Go to a point and then stay there. `CommandAccepted`, then `Arrived` or `CommandFailed`, repeat `command_id`."""

    command_id: int
    north_m: float
    east_m: float
    speed_m_s: float
    victory_radius_m: float


@dataclass(frozen=True, slots=True)
class Hold:
    """Hold position dynamically at a point until the next command. No heading means any heading.

    It never completes by itself; as a primitive it succeeds when the next one replaces it.
    """

    command_id: int
    north_m: float
    east_m: float
    heading_rad: float | None = None
    pre_empts: bool = False
    """It takes the vehicle from every other client: a person's stop, or a guard's."""


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """Limits of turning and approach in a visual docking, ignored by others; None means the scenario's value."""

    yaw_rate_rad_s: float | None = None
    surge_m_s: float | None = None


DEFAULT_MANOEUVRE = Manoeuvre()


@dataclass(frozen=True, slots=True)
class CloseDock:
    """Close docking mechanism `dock_index` around aMussel `agent_id`, where the vehicle is."""

    command_id: int
    dock_index: int
    agent_id: int
    manoeuvre: Manoeuvre = DEFAULT_MANOEUVRE


@dataclass(frozen=True, slots=True)
class OpenDock:
    """Open docking mechanism `dock_index` and let aMussel `agent_id` go.

    As a primitive: a dock that the vehicle reported for the aMussel overrides `dock_index`.
    """

    command_id: int
    dock_index: int
    agent_id: int
    manoeuvre: Manoeuvre = DEFAULT_MANOEUVRE


@dataclass(frozen=True, slots=True)
class MoveArm:
    """Open or close the arm of dock `dock_index` for people to see; it catches nothing and gets no answer."""

    command_id: int
    dock_index: int
    is_open: bool


@dataclass(frozen=True, slots=True)
class Stop:
    """Switch the controllers off, without a position to hold: the water takes the vehicle.

    It takes the vehicle from every other client. `CommandAccepted` or `CommandFailed` repeat `command_id`.
    """

    command_id: int


@dataclass(frozen=True, slots=True)
class PilotLeft:
    """A person says that no pilot steers any more, whatever the pilot's flag said last. It gets no answer."""

    command_id: int


@dataclass(frozen=True, slots=True)
class ReleaseByName:
    """Release an aMussel that no dock is known to hold, and that one may hold all the same. It gets no answer."""

    command_id: int
    dock_index: int
    agent_id: int


Primitive = GoTo | Hold | CloseDock | OpenDock
"""The orders of a mission to the docking port."""
PRIMITIVE_NAMES: dict[type, str] = {
    GoTo: "go to point",
    Hold: "hold position",
    CloseDock: "dock",
    OpenDock: "undock",
}
VehicleCommand = Primitive | MoveArm | Stop | PilotLeft | ReleaseByName


@dataclass(frozen=True, slots=True)
class PoseReported:
    at_ms: int
    north_m: float
    east_m: float
    heading_rad: float
    stamp_ms: int | None = None
    """The position's own time, by the vehicle's clock: only differences count. None from a vehicle that gives none."""
    speed_m_s: float | None = None
    """The speed over ground that the vehicle itself measures; None from a vehicle that gives none."""
    publisher: str = ""
    """The node that published the position; empty where that is not known."""
    also_from: str = ""
    """Another node that published a position since the pose before; empty for none."""
    heard_ms: int | None = None
    """The time of arrival, by a clock that no late tick holds up: only differences count. None where `at_ms` is it."""

    @property
    def place_m(self) -> tuple[float, float]:
        return self.north_m, self.east_m


@dataclass(frozen=True, slots=True)
class BatteryReported:
    """The aPad's battery: terminal voltage, and the fraction of [10.5, 16] V that is left, in [0, 1]."""

    at_ms: int
    voltage_v: float
    fraction: float


@dataclass(frozen=True, slots=True)
class CommandAccepted:
    """The vehicle has taken a go-to or a hold, and follows it from now on. A repeated order is accepted again.

    Whoever waits for the vehicle to follow counts from here: until then the order may be on its way.
    """

    at_ms: int
    command_id: int


@dataclass(frozen=True, slots=True)
class Arrived:
    at_ms: int
    command_id: int


@dataclass(frozen=True, slots=True)
class CommandFailed:
    at_ms: int
    command_id: int
    reason: str


@dataclass(frozen=True, slots=True)
class DockClosed:
    """The mechanism closed and made contact. The vehicle reports the dock, which may differ from the command."""

    at_ms: int
    dock_index: int
    agent_id: int


@dataclass(frozen=True, slots=True)
class DockOpened:
    at_ms: int
    dock_index: int
    agent_id: int


@dataclass(frozen=True, slots=True)
class DocksNamed:
    """The vehicle's service about its docks, which answers apart from its reports, names some of those reported."""

    at_ms: int
    held: frozenset[int]
    """The aMussels in docks by the vehicle's reports."""
    named: frozenset[int]
    """Those that the service names; never empty, because a service that names nobody may know of no docking."""


@dataclass(frozen=True, slots=True)
class CommandedByOthers:
    """Another party commands a vehicle that is a person's to give back: the mission should stand aside."""

    at_ms: int
    client: str = ""
    """The node that gave the order; empty where the stack does not tell."""


@dataclass(frozen=True, slots=True)
class HoldWanted:
    """The vehicle has no order under way any more, and would drift: it should hold this place.

    A link orders nothing by itself. The gate's owner decides.
    """

    at_ms: int
    north_m: float
    east_m: float
    heading_rad: float | None = None


@dataclass(frozen=True, slots=True)
class ReleaseWanted:
    """A dock that opened by silence alone may still hold this aMussel: the vehicle should release it by name."""

    at_ms: int
    dock_index: int
    agent_id: int


@dataclass(frozen=True, slots=True)
class OrderCut:
    """A stop has ended an order that was on its way. The vehicle may have heard it, and may carry it out late."""

    at_ms: int


@dataclass(frozen=True, slots=True)
class PilotReported:
    """A pilot steers, or steers no more. None: nobody publishes the pilot's flag any more, so that nobody can tell."""

    at_ms: int
    steers: bool | None


@dataclass(frozen=True, slots=True)
class GoalOfOthers:
    """Another client's go-to, where the stack shows it. Guards judge it like our own.

    A goal whose message was not heard, or names a place of no water, has no place: nobody here can tell where it leads.
    """

    at_ms: int
    client: str
    north_m: float | None
    east_m: float | None
    fault: str = ""
    """Why the place that the message names cannot be used; empty for a good one, and for a message that was not heard."""


VehicleFact = (
    PoseReported
    | BatteryReported
    | CommandAccepted
    | Arrived
    | CommandFailed
    | HoldWanted
    | ReleaseWanted
    | OrderCut
    | DockClosed
    | DockOpened
    | DocksNamed
    | CommandedByOthers
    | PilotReported
    | GoalOfOthers
)
