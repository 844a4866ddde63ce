"""The scenario: everything that a run depends on, as frozen dataclasses that check their values on creation.

Lengths are metres, speeds m/s. Durations are seconds of mission time unless a name contains `agent`: then they are
seconds of the aMussels' own time, which runs theta times faster. Charge is the paper's scaled voltage in [0, 1].
Nothing physical has a default: a key is optional only if leaving it out has one obvious meaning.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Literal

from annotated_types import Ge, Le
from pydantic import Tag

from agents.time_scale import MissionMs, TimeScale
from agents.water.bounds import Count
from apad_bridge.scenario.another_apad import AnotherAPad, Sharing
from apad_bridge.scenario.area.fence import check_corners
from apad_bridge.scenario.board import Board
from apad_bridge.scenario.choices import MAX_DOCKS, PAPER_DOCKS, Generation, Hosting
from apad_bridge.scenario.estimator_options import Beliefs
from apad_bridge.scenario.faults import OF_A, OF_B, Fault
from apad_bridge.scenario.guard_options import GuardOptions
from apad_bridge.scenario.quantities import (
    VALUES,
    VALUES_OR_FILE,
    EndTime,
    FileName,
    Fraction,
    NotNegative,
    NotNegativeSeconds,
    Place,
    Positive,
    PositiveFraction,
    PositiveSeconds,
    RosNamespace,
    Speed,
    TheirFile,
    frozen,
)
from apad_bridge.scenario.starts_table import MAX_AGENT_ID
from apad_bridge.scenario.timed_faults import Faults
from apad_bridge.scenario.water.options import Water

AgentId = Annotated[int, Ge(1), Le(MAX_AGENT_ID)]


@frozen
class Origin:
    """The geographic position of local NED (0, 0)."""

    latitude_deg: Annotated[float, Ge(-89.9), Le(89.9)]
    longitude_deg: Annotated[float, Ge(-180), Le(180)]


@frozen
class Area:
    origin: Origin
    polygon_m: tuple[Place, ...]
    """Corners as (north, east), in order, not closed; three or more."""
    depth_m: Positive
    fence: Annotated[Annotated[tuple[Place, ...], Tag(VALUES)] | TheirFile, VALUES_OR_FILE] | None = None
    """The waters that no order may take the aPad out of: corners as in `polygon_m`, or a GeoJSON file with one polygon.
    None, for a simulated aPad alone: there is no fence."""
    keep_out: Annotated[
        Annotated[tuple[tuple[Place, ...], ...], Tag(VALUES)] | TheirFile, VALUES_OR_FILE
    ] = ()
    """Zones inside the fence that no way may touch: a list of polygons, or a GeoJSON file."""
    chart: str | None = None
    """The shore and depth contours, which maps show and nothing else reads: a GeoJSON file, or a name of PAPER_CHARTS."""
    home_m: Place | None = None
    """(north, east) of the place to which the aPad's battery must always suffice; None: `apad.start_m`."""

    def __post_init__(self) -> None:
        check_corners(self.polygon_m, "polygon_m")
        if self.fence is not None and not isinstance(self.fence, str):
            check_corners(self.fence, "fence")
        for n, zone in enumerate(() if isinstance(self.keep_out, str) else self.keep_out):
            check_corners(zone, f"keep_out[{n}]")
        if self.keep_out and self.fence is None:
            raise ValueError("keep_out lies inside a fence: add fence")


@frozen
class RandomStart:
    """Random positions uniform in the polygon and primary charges uniform in `charge`, both from the scenario's seed."""

    charge: tuple[Fraction, Fraction]

    def __post_init__(self) -> None:
        if self.charge[0] > self.charge[1]:
            raise ValueError("charge must be [low, high]")


class DriftMode(StrEnum):
    """`paper`: a random step each mission second, always. `physical`: bodies off the bottom follow the current only."""

    PAPER = "paper"
    PHYSICAL = "physical"


@frozen
class Drift:
    mode: DriftMode
    amplitude_m: Annotated[float, Ge(0), Le(100)] = 0.0
    """Half width of the uniform step that `paper` mode adds to north and to east each mission second."""
    current_file: str | None = None
    """CSV: north_m, east_m, north_m_s, east_m_s; relative to the scenario file."""
    current_m_s: tuple[Speed, Speed] | None = None
    """(north, east) velocity of a current that is the same everywhere, instead of a file."""


SpreadDeviation = Annotated[float, Ge(0), Le(0.3)]
"""Draws are cut at three deviations, so that at least a tenth of the nominal is left."""


@frozen
class SpreadOptions:
    """Spread of the fleet's aMussels about their board's numbers: one standard deviation, relative. The draws follow
    from the scenario's seed; no estimator knows them."""

    drain: SpreadDeviation = 0.0
    capacity: SpreadDeviation = 0.0
    """Applies to both batteries of an aMussel alike: smaller ones drain and charge faster."""
    secondary_start: SpreadDeviation = 0.0
    """Distance below full at which a secondary battery starts, where the start does not state its charge."""
    drain_bias: Annotated[float, Ge(-0.5), Le(0.5)] = 0.0
    """All boards drain by so much more than their numbers say, relative: the planner and the estimators are wrong by it."""


@frozen
class FirmwareProgram:
    """Somebody's firmware on the aMussels' boards: docs/firmware-port.md."""

    executable: str
    """Relative to the scenario file; or `serial:DEVICE`, a real board on a serial line."""
    arguments: tuple[str, ...] = ()
    agents: tuple[AgentId, ...] = ()
    """The ids that it runs on; empty for all that no other firmware names."""


@frozen
class Fleet:
    count: Annotated[int, Ge(0), Le(20000)]
    first_id: AgentId = 1
    agent_ids: tuple[AgentId, ...] = ()
    """The ids, rising, where they have gaps; empty for `count` ids from `first_id` on. The loader takes these three from
    the file that `start` names if a scenario leaves `count` out."""
    start: Annotated[Annotated[RandomStart, Tag(VALUES)] | TheirFile, VALUES_OR_FILE] = "starts.csv"
    """A mapping for a random start, the name of a CSV (id, lat, lon or north, east, battery), or a former run's directory.
    Names are relative to the scenario file; the loader makes them absolute."""
    share: tuple[AgentId, ...] = ()
    """The ids that this aPad serves if it is one of several; empty for all."""
    hosting: Hosting = Hosting.PROCESSES
    drift: Drift
    spread: SpreadOptions = SpreadOptions()
    firmware: tuple[FirmwareProgram, ...] = ()
    """Somebody's firmware on boards; the others have ours."""

    def __post_init__(self) -> None:
        ids = self.agent_ids
        if list(ids) != sorted(set(ids)):
            raise ValueError("agent_ids must be rising, each id once")
        if ids and (self.first_id, self.count) != (ids[0], len(ids)):
            raise ValueError(
                f"agent_ids names {len(ids)} aMussels from {ids[0]} on, first_id and count say {self.count} from "
                f"{self.first_id} on: leave fleet.count and fleet.first_id out"
            )
        if self.first_id + self.count - 1 > MAX_AGENT_ID:
            raise ValueError(
                f"first_id: an aMussel's id is {MAX_AGENT_ID} at most, not {self.first_id + self.count - 1}"
            )
        if list(self.share) != sorted(set(self.share)) or not set(self.share) <= set(self.all_ids):
            raise ValueError("share must name some of the fleet's ids, each once and rising")

    @property
    def ids(self) -> Sequence[int]:
        """The ids that this aPad serves, ascending."""
        return self.share or self.all_ids

    @property
    def all_ids(self) -> Sequence[int]:
        """The whole fleet's ids, ascending, whichever aPad serves them. An aMussel's place among them is its timeslot."""
        return self.agent_ids or range(self.first_id, self.first_id + self.count)


class HearingMode(StrEnum):
    """`paper`: every agent reports over Wi-Fi at a fixed rate, always. `physical`: only while it floats or is docked."""

    PAPER = "paper"
    PHYSICAL = "physical"


class Positioning(StrEnum):
    """The place in a status packet. `gps`: at the surface a GPS fix, below the last fix from there, whatever moved the
    aMussel since. `ground_truth`: always where it is, as in the paper's simulation."""

    GPS = "gps"
    GROUND_TRUTH = "ground_truth"


@frozen
class Hearing:
    mode: HearingMode
    report_period_s: PositiveSeconds
    """Mission seconds between Wi-Fi reports."""
    positioning: Positioning = Positioning.GPS
    gps_deviation_m: NotNegative = 0.5
    """Standard deviation of a fix along one axis, beside the slow errors that the aPad's receiver shares. Assumed."""
    codec: str = "musselbed-1"


class DockingProfile(StrEnum):
    """`virtual`: the bench waits, then makes the contact. `camera`: the vehicle's own visual servoing, fed with the
    simulated aMussel's place in the image. `visual`: the same servoing with the vehicle's camera, for real aMussels."""

    VIRTUAL = "virtual"
    CAMERA = "camera"
    VISUAL = "visual"


class ArmUse(StrEnum):
    """The use of the vehicle's arm in a virtual docking: left alone, or opened for the time of the docking."""

    ALONE = "alone"
    MOVED = "moved"


@frozen
class Servo:
    """Parameters of the vehicle's own visual servoing, and its time limit."""

    search_yaw_rate_rad_s: Positive
    max_yaw_rate_rad_s: Positive
    max_surge_m_s: Positive
    surge_stdev: Positive
    """Standard deviation of the target's horizontal place in the image (half the image's width is 1). The vehicle
    approaches the slower, the farther the target is off the centre."""
    search_s: PositiveSeconds
    """A docking is given up if it has not ended this long after the vehicle accepted the order."""


@frozen
class Docking:
    profile: DockingProfile
    virtual_ids: tuple[AgentId, ...] = ()
    camera_ids: tuple[AgentId, ...] = ()
    visual_ids: tuple[AgentId, ...] = ()
    """These three keys list the aMussels that are docked otherwise than by `profile`."""
    dock_s: NotNegativeSeconds
    undock_s: NotNegativeSeconds
    timeout_s: PositiveSeconds
    attempts: Annotated[int, Ge(1), Le(10)] = 1
    """The number of tries before the mission gives the aMussel up for this time."""
    catch_radius_m: Positive = 0.5
    """A virtual docking catches an aMussel that floats no farther than this from the aPad. Assumed: the mechanisms stand
    0.4 m from its middle."""
    arm: ArmUse = ArmUse.ALONE
    servo: Servo | None = None

    def __post_init__(self) -> None:
        if self.timeout_s <= max(self.dock_s, self.undock_s):
            raise ValueError("timeout_s must be longer than dock_s and undock_s")
        listed_ids = (*self.virtual_ids, *self.camera_ids, *self.visual_ids)
        if len(set(listed_ids)) < len(listed_ids):
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
    flow: bool = True
    """The scenario's current and wind count in the way's cost and time. False: the way over ground alone."""


class FullWhen(StrEnum):
    """The batteries that must be above the threshold for a docked aMussel to be full."""

    PRIMARY = "primary"
    BOTH = "both"


class Suspects(StrEnum):
    """The treatment of an aMussel whose packets contradict physics: people are told of it in any case.

    `asked`: the aPad asks it for its status by sound, from time to time. `fetched`: it is collected once, for a look.
    """

    TOLD = "told"
    ASKED = "asked"
    FETCHED = "fetched"


class Dispatch(StrEnum):
    """The rule of collecting and releasing, for every strategy alike. `batch`: the paper's, a whole batch is collected,
    charged and released. `asynchronous`: each aMussel by itself, as soon as a dock is free for it, until it is charged."""

    BATCH = "batch"
    ASYNCHRONOUS = "asynchronous"


class Places(StrEnum):
    """The place to which an aMussel is brought back. `own`: its own, as in the paper. `exchanged`: that of one which is
    collected on the same tour, or else the nearest of the docked ones' places; the two exchange places."""

    OWN = "own"
    EXCHANGED = "exchanged"


class Horizon(StrEnum):
    """The time for which aMussels are charged. `open`: as long as they live. `end`: until the mission's end, so nobody is
    collected who lasts until then, and nobody is charged for longer."""

    OPEN = "open"
    END = "end"


@frozen
class Mission:
    collection: str
    """Name of a collection strategy: one of docs/studies.md, as `cautious`, or one from a user's package."""
    redeployment: str = "greedy-redeploy"
    places: Places = Places.OWN
    pool_threshold: Fraction
    batch: Annotated[int, Ge(1), Le(MAX_DOCKS)]
    """Left out in a file: the number of the aPad's docks. `dispatch: asynchronous` has no batches."""
    dispatch: Dispatch = Dispatch.BATCH
    again_threshold: Fraction | None = None
    """An aMussel that the mission brought back is in the pool again once one in it is at or below this. None: at once below
    `pool_threshold`."""
    full_threshold: Fraction
    charge_to: Fraction | None = None
    """A docked aMussel above this makes room when others wait for its dock. None: only full aMussels leave."""
    charge_lead: PositiveFraction | None = None
    """A docked aMussel that has so much more charge than the one that waits makes room for it, too. None: it does not."""
    full_when: FullWhen = FullWhen.PRIMARY
    horizon: Horizon = Horizon.OPEN
    speed_m_s: Positive
    victory_radius_m: Positive
    docking: Docking
    costs: Costs = Costs()
    end_at_apad_fraction: Fraction = 0.0
    """The mission ends when the aPad's battery falls to this."""
    end_by: EndTime | None = None
    """The mission is home by then: a local time as 16:30, or seconds of mission time."""
    permission_repeat_s: PositiveSeconds
    """The mission repeats an unanswered permission to surface after this time."""
    surfacing_attempts: Count
    silence_timeout_s: PositiveSeconds
    """The mission stops waiting for an aMussel that has been silent for this long, and goes on without it."""
    collection_attempts: Count = 5
    """The mission leaves an aMussel alone after so many tries in a row that did not help it."""
    suspects: Suspects = Suspects.TOLD
    """Needs twins, which alone find suspects."""


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

    @property
    def range_v(self) -> tuple[float, float]:
        """The voltages of the empty and of the full battery."""
        return self.empty_v, self.full_v


@dataclass(frozen=True, slots=True)
class GenerationLimits:
    """The scenario keys that a generation can serve."""

    faults: frozenset[Fault]
    """The faults that its simulated aPad can have."""
    docks: int = MAX_DOCKS
    """The docks that its messages can name."""


_LIMITS_OF_A = GenerationLimits(OF_A)
LIMITS = dict.fromkeys(Generation, GenerationLimits(frozenset({Fault.NONE}))) | {
    Generation.AUTO: _LIMITS_OF_A,
    Generation.A: _LIMITS_OF_A,
    Generation.B: GenerationLimits(OF_B, docks=4),  # its docking primitive knows slots 0 to 3
}


class DockedAtHome(StrEnum):
    """The docked aMussels of an aPad that goes home: they come along and go on charging, or leave their docks first."""

    CHARGE = "charge"
    RELEASED = "released"


@frozen
class Home:
    """The mission takes the aPad home, to `area.home_m` or else `apad.start_m`, where its battery is charged."""

    charging_w: Positive
    """The charger's power, of which the aPad's own loads take their part."""
    go_at: Fraction
    """With this part of its battery or less, it goes home before it takes up another plan."""
    leave_at: Fraction = 1.0
    docked: DockedAtHome = DockedAtHome.CHARGE

    def __post_init__(self) -> None:
        if self.leave_at <= self.go_at:
            raise ValueError("leave_at must be above go_at, or it would go home again at once")


@frozen
class Unavailable:
    """A span of mission time in which the aPad takes up no plan and goes home."""

    from_s: NotNegativeSeconds
    until_s: PositiveSeconds

    def __post_init__(self) -> None:
        if self.until_s <= self.from_s:
            raise ValueError("until_s must be after from_s")


@frozen
class APad:
    """The simulated aPad. A real aPad needs its name, and its generation if it offers both."""

    profile: Literal["paper"] | None = None
    name: RosNamespace = "apad1"
    generation: Generation = Generation.AUTO
    interface: str | None = None
    """A YAML file with the laboratory's own topics, relative to the scenario file; None for musselbed's topics."""
    docks: Annotated[int, Ge(1), Le(MAX_DOCKS)] = PAPER_DOCKS
    """The number of its docking mechanisms. Where on the hull they are follows from its software."""
    start_m: Place
    max_speed_m_s: Positive
    max_acceleration_m_s2: Positive
    max_yaw_rate_rad_s: Positive
    mass_kg: Positive
    drag_n_per_m2_s2: NotNegative
    """Quadratic drag: newtons at 1 m/s."""
    thruster_max_n: Positive
    thruster_w_per_n: NotNegative
    wind_n_per_m2_s2: NotNegative = 0.08
    """Quadratic drag in air: newtons of a wind of 1 m/s. Assumed: half of 1.2 kg/m3, times 0.8, times 0.17 m2 of hull."""
    drift_m_s: tuple[Speed, Speed] = (0.0, 0.0)
    """Velocity (north, east) of a drift that was measured with the controllers off, and acts then alone. A current or a
    wind of the scenario takes its place."""
    fault: Fault = Fault.NONE
    """The misbehaviour of the simulated aPad's ROS node."""
    dock_miss_probability: Fraction = 0.05
    """Probability that a docking misses; the scenario's seed decides which dockings do. Assumed."""
    battery: APadBattery
    home: Home | None = None
    """None: the aPad is not charged, and goes home only when it is unavailable."""
    unavailable: tuple[Unavailable, ...] = ()

    def __post_init__(self) -> None:
        limits = LIMITS[self.generation]
        if self.fault not in limits.faults:
            raise ValueError(
                f"fault: {self.fault} is of another generation; possible are: {', '.join(sorted(limits.faults))}"
            )
        if self.docks > limits.docks:
            raise ValueError(
                f"docks: {self.docks} are more than the {limits.docks} that an aPad of generation "
                f"{self.generation} can name"
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
    theta: Annotated[int, Ge(1), Le(1_000_000)]
    area: Area
    fleet: Fleet
    board: Board
    hearing: Hearing
    mission: Mission
    apad: APad
    apads: tuple[AnotherAPad, ...] = ()
    """Further aPads, which share the fleet with `apad`."""
    sharing: Sharing = Sharing()
    records: Records = Records()
    beliefs: Beliefs = Beliefs()
    guards: GuardOptions | None = None
    """Limits of every order that moves the aPad; None: a fence alone has the defaults."""
    faults: Faults | None = None
    """Faults of simulated aMussels and of the simulated aPad, at their times; None for none."""
    water: Water | None = None
    """None: every message arrives at once and whole, as in the paper's experiments."""

    @property
    def apad_names(self) -> list[str]:
        """The names of all aPads, `apad` first."""
        return [self.apad.name, *(it.name for it in self.apads)]

    @property
    def time_scale(self) -> TimeScale:
        return TimeScale(self.theta)

    @property
    def duration_ms(self) -> MissionMs:
        """The mission ends at the first tick at or after this time, if nothing ends it before."""
        return MissionMs(round(self.duration_s * 1000))
