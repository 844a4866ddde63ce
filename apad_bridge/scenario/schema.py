"""The scenario: everything a run depends on, as frozen dataclasses that are checked at birth.

Lengths are metres, speeds m/s, durations seconds of mission time unless a name says `agent` (then seconds of the
aMussels' own time, theta times faster), charge is the paper's scaled voltage in [0, 1]. Nothing physical has a default:
a key is optional only where leaving it out has one obvious meaning.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated

from annotated_types import Ge, Le

from apad_bridge.scenario.another_apad import AnotherAPad, Sharing
from apad_bridge.scenario.believing import Beliefs
from apad_bridge.scenario.board import Board
from apad_bridge.scenario.faults import OF_A, OF_B, Fault
from apad_bridge.scenario.polygon import area_m2, is_simple
from apad_bridge.scenario.quantities import (
    FileName,
    Fraction,
    NotNegative,
    NotNegativeSeconds,
    Positive,
    PositiveSeconds,
    RosNamespace,
    frozen,
)
from apad_bridge.scenario.water import Water


@frozen
class Origin:
    """Where local NED (0, 0) lies."""

    latitude_deg: Annotated[float, Ge(-89.9), Le(89.9)]
    longitude_deg: Annotated[float, Ge(-180), Le(180)]


@frozen
class Area:
    origin: Origin
    polygon_m: tuple[tuple[float, float], ...]
    """Corners as (north, east), in order, not closed; three or more."""
    depth_m: Positive

    def __post_init__(self) -> None:
        if len(self.polygon_m) < 3:
            raise ValueError("polygon_m needs three corners or more")
        if not is_simple(self.polygon_m):
            raise ValueError("polygon_m crosses or touches itself")
        if area_m2(self.polygon_m) < 1e-6:
            raise ValueError("polygon_m encloses no area")


@frozen
class RandomStart:
    """Positions uniform in the polygon, primary charges uniform in `charge`; both from the scenario's seed."""

    charge: tuple[Fraction, Fraction]

    def __post_init__(self) -> None:
        if self.charge[0] > self.charge[1]:
            raise ValueError("charge must be [low, high]")


class Hosting(StrEnum):
    PROCESSES = "processes"
    ONE_PROCESS = "one_process"


class DriftMode(StrEnum):
    """`paper`: a random step each mission second, always. `physical`: bodies off the bottom follow the current only."""

    PAPER = "paper"
    PHYSICAL = "physical"


@frozen
class Drift:
    mode: DriftMode
    amplitude_m: NotNegative = 0.0
    """Half width of the uniform step that `paper` mode adds to north and to east each mission second."""
    current_file: str | None = None
    """CSV: north_m, east_m, north_m_s, east_m_s; relative to the scenario file."""


@frozen
class Fleet:
    count: Annotated[int, Ge(0), Le(20000)]
    first_id: Annotated[int, Ge(1)] = 1
    start: RandomStart | str = "starts.csv"
    """A mapping for a random start, or a CSV's name: id, lat, lon (or north, east), battery; or a former run's directory.
    Names are relative to the scenario file; the loader makes them absolute. Of a file, the `count` lowest ids from
    `first_id` on are taken."""
    share: tuple[Annotated[int, Ge(1)], ...] = ()
    """Only these of them, for one of several aPads; all if there are none."""
    hosting: Hosting = Hosting.PROCESSES
    drift: Drift

    def __post_init__(self) -> None:
        if list(self.share) != sorted(set(self.share)) or not all(it in self.all_ids for it in self.share):
            raise ValueError("share must name some of the fleet's ids, each once and rising")

    @property
    def ids(self) -> Sequence[int]:
        """Rising."""
        return self.share or self.all_ids

    @property
    def all_ids(self) -> range:
        """Of the whole fleet, whoever serves them."""
        return range(self.first_id, self.first_id + self.count)


class HearingMode(StrEnum):
    """`paper`: every agent reports over Wi-Fi at a fixed rate, always. `physical`: Wi-Fi only floating or docked."""

    PAPER = "paper"
    PHYSICAL = "physical"


@frozen
class Hearing:
    mode: HearingMode
    report_period_s: PositiveSeconds
    """Mission seconds between Wi-Fi reports."""
    codec: str = "musselbed-1"


class DockingProfile(StrEnum):
    """`virtual`: the bench waits, then makes the contact. `camera`: the vehicle's own visual servoing, which is shown the
    simulated aMussel. `visual`: the same servoing with its own eyes, for real aMussels."""

    VIRTUAL = "virtual"
    CAMERA = "camera"
    VISUAL = "visual"


class ArmUse(StrEnum):
    """What a virtual docking does with the vehicle's arm: it is left alone, or opened for the time of the docking."""

    ALONE = "alone"
    MOVED = "moved"


@frozen
class Servo:
    """What the vehicle's own docking is told, and how long it may take."""

    search_yaw_rate_rad_s: Positive
    max_yaw_rate_rad_s: Positive
    max_surge_m_s: Positive
    surge_stdev: Positive
    """Of the target's place across the image (half its width is 1): the farther off, the slower the approach."""
    search_s: PositiveSeconds
    """A docking that has not come to its end so long after the vehicle took the order is given up."""


@frozen
class Docking:
    profile: DockingProfile
    virtual_ids: tuple[int, ...] = ()
    camera_ids: tuple[int, ...] = ()
    visual_ids: tuple[int, ...] = ()
    """aMussels that are docked otherwise than by `profile`."""
    dock_s: NotNegativeSeconds
    undock_s: NotNegativeSeconds
    timeout_s: PositiveSeconds
    attempts: Annotated[int, Ge(1), Le(10)] = 1
    """So often a docking is tried before the aMussel is given up for this time."""
    arm: ArmUse = ArmUse.ALONE
    servo: Servo | None = None

    def __post_init__(self) -> None:
        if self.timeout_s <= max(self.dock_s, self.undock_s):
            raise ValueError("timeout_s must be longer than dock_s and undock_s")
        named = (*self.virtual_ids, *self.camera_ids, *self.visual_ids)
        if len(set(named)) < len(named):
            raise ValueError("virtual_ids, camera_ids and visual_ids must not name an aMussel twice")
        if self.servo is not None and self.timeout_s <= self.servo.search_s:
            raise ValueError("timeout_s must be longer than servo.search_s")

    def profile_of(self, agent_id: int) -> DockingProfile:
        if agent_id in self.virtual_ids:
            return DockingProfile.VIRTUAL
        if agent_id in self.camera_ids:
            return DockingProfile.CAMERA
        return DockingProfile.VISUAL if agent_id in self.visual_ids else self.profile


@frozen
class Costs:
    """Scale factors of the planner's cost modules."""

    distance_per_m: NotNegative = 1.0
    energy_per_charge: NotNegative = 1.0


class FullWhen(StrEnum):
    """Which of its batteries have to be above the threshold for a docked aMussel to be full."""

    PRIMARY = "primary"
    BOTH = "both"


@frozen
class Mission:
    collection: str
    """Name of a collection strategy: `none`, `greedy`, `cautious`, or one from a user's package."""
    redeployment: str = "greedy-redeploy"
    pool_threshold: Fraction
    batch: Annotated[int, Ge(1), Le(4)]
    full_threshold: Fraction
    full_when: FullWhen = FullWhen.PRIMARY
    speed_m_s: Positive
    victory_radius_m: Positive
    docking: Docking
    costs: Costs = Costs()
    end_at_apad_fraction: Fraction = 0.0
    """The mission ends when the aPad's battery falls to this."""
    permission_repeat_s: PositiveSeconds
    """An unanswered permission to surface is repeated after so long."""
    surfacing_attempts: Annotated[int, Ge(1)]
    silence_timeout_s: PositiveSeconds
    """An aMussel unheard for so long is not waited for: the mission goes on without it."""


@frozen
class APadBattery:
    full_v: Positive
    empty_v: Positive
    capacity_wh: Positive
    start_fraction: Fraction
    hotel_w: NotNegative
    charging_w_per_dock: NotNegative

    def __post_init__(self) -> None:
        if self.full_v <= self.empty_v:
            raise ValueError("full_v must be above empty_v")


class Generation(StrEnum):
    """Of the aPad's software. `auto`: what the live graph offers; the simulated aPad is then of generation `a`."""

    AUTO = "auto"
    A = "a"
    """The action `action_server`."""
    B = "b"
    """Mission primitives: services below `commander/primitive`."""


@frozen
class APad:
    """The simulated aPad. A real one needs its name, and its generation where it offers both."""

    name: RosNamespace = "apad1"
    generation: Generation = Generation.AUTO
    interface: str | None = None
    """A YAML file with the laboratory's own topics, relative to the scenario file; those of musselbed if there is none."""
    start_m: tuple[float, float]
    max_speed_m_s: Positive
    max_acceleration_m_s2: Positive
    max_yaw_rate_rad_s: Positive
    mass_kg: Positive
    drag_n_per_m2_s2: NotNegative
    """Quadratic drag: newtons at 1 m/s."""
    thruster_max_n: Positive
    thruster_w_per_n: NotNegative
    drift_m_s: tuple[float, float] = (0.0, 0.0)
    """What the water carries it with, north and east, while its controllers are off; they make good for it otherwise."""
    fault: Fault = Fault.NONE
    """What the simulated aPad's ROS node does wrong."""
    dock_miss_probability: Fraction = 0.0
    """That a docking misses; which ones do follows from the scenario's seed."""
    battery: APadBattery

    def __post_init__(self) -> None:
        possible = OF_B if self.generation is Generation.B else OF_A
        if self.fault not in possible:
            raise ValueError(
                f"fault: {self.fault} is of the other generation; possible are: {', '.join(sorted(possible))}"
            )


@frozen
class Records:
    record_period_s: PositiveSeconds = 1.0
    """Bag samples: per tick for the first day, then at this period."""
    truth_on_agent_topics: bool = False
    """Publish the truth, not the report, on /amusselK/position and battery_level, as generation A's simulator did."""


@frozen
class Scenario:
    name: FileName
    """Letters, digits, dot, dash and underscore: run directories are named after it."""
    description: str = ""
    seed: Annotated[int, Ge(0), Le(2**63 - 1)]
    duration_s: PositiveSeconds
    theta: Annotated[int, Ge(1)]
    area: Area
    fleet: Fleet
    board: Board
    hearing: Hearing
    mission: Mission
    apad: APad
    apads: tuple[AnotherAPad, ...] = ()
    """More of them, which share the fleet with `apad`."""
    sharing: Sharing = Sharing()
    records: Records = Records()
    beliefs: Beliefs = Beliefs()
    water: Water | None = None
    """None: everything that is said gets through, at once and whole, as in the paper's experiments."""
