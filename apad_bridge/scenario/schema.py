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
from agents.water.bounds import NotNegative
from apad_bridge.planning.dispatch_rule import MAX_DOCKS
from apad_bridge.scenario.another_apad import AnotherAPad, Sharing
from apad_bridge.scenario.area.fence import check_corners, check_size
from apad_bridge.scenario.blocks.board_options import BoardOptions
from apad_bridge.scenario.blocks.estimator_options import Beliefs
from apad_bridge.scenario.blocks.guard_options import GuardOptions
from apad_bridge.scenario.blocks.mission_options import Mission
from apad_bridge.scenario.choices import PAPER_DOCKS, Generation, Hosting
from apad_bridge.scenario.faults import OF_A, OF_B, Fault
from apad_bridge.scenario.quantities import (
    VALUES,
    VALUES_OR_FILE,
    AgentId,
    FileName,
    Fraction,
    NotNegativeSeconds,
    Place,
    Positive,
    PositiveSeconds,
    RosNamespace,
    Speed,
    TheirFile,
    frozen,
)
from apad_bridge.scenario.timed_faults import Faults
from apad_bridge.scenario.water.water_options import Water
from firmware_model.packets.wire import MAX_AGENT_ID
from firmware_model.sampling.sensors import BROUGHT


@frozen
class Origin:
    """The geographic position of local NED (0, 0)."""

    latitude_deg: Annotated[float, Ge(-89.9), Le(89.9)]
    """Latitude of the origin."""
    longitude_deg: Annotated[float, Ge(-180), Le(180)]
    """Longitude of the origin."""


@frozen
class Area:
    origin: Origin
    polygon_m: tuple[Place, ...]
    """Corners as (north, east), in order, three or more, not closed and not crossing itself. `polygon` in its place is a
    GeoJSON file with one polygon, or a list of [latitude, longitude] in degrees. Either measures 1 m or more north
    and east."""
    depth_m: Positive
    """Depth of the bottom, the same everywhere."""
    fence: Annotated[Annotated[tuple[Place, ...], Tag(VALUES)] | TheirFile, VALUES_OR_FILE] | None = None
    """The waters that no order may take the aPad out of: corners as in `polygon_m`, or a GeoJSON file with one polygon,
    whose holes are keep-out zones. Such a file has [longitude, latitude] in degrees. None, for a simulated aPad alone:
    there is no fence."""
    keep_out: Annotated[
        Annotated[tuple[tuple[Place, ...], ...], Tag(VALUES)] | TheirFile, VALUES_OR_FILE
    ] = ()
    """Zones inside the fence, which they need, that no way may touch: a list of polygons, or a GeoJSON file with any
    number. The aPad goes straight, and round none of them."""
    chart: str | None = None
    """The shore and depth contours, which maps show and nothing else reads: a GeoJSON file with lines or polygons, where a
    Feature with the property `depth_m` is a contour; or `paper-pool` or `paper-bay`, simple shapes of the paper's areas."""
    home_m: Place | None = None
    """The place to which the aPad's battery must always suffice (`guards.battery_reserve`). None: `apad.start_m`."""

    def __post_init__(self) -> None:
        check_size(self.polygon_m, "polygon_m", "write them as area.polygon, in pairs [latitude, longitude]")
        if self.fence is not None and not isinstance(self.fence, str):
            check_size(self.fence, "fence", "name a GeoJSON file in its place")
        for n, zone in enumerate(() if isinstance(self.keep_out, str) else self.keep_out):
            check_corners(zone, f"keep_out[{n}]")
        if self.keep_out and self.fence is None:
            raise ValueError("keep_out lies inside a fence: add fence")


@frozen
class RandomStart:
    """Random positions uniform in the polygon and primary charges uniform in `charge`, both from the scenario's seed."""

    charge: tuple[Fraction, Fraction]
    """[low, high] of the charges."""

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
    """`paper`: a random step each second of mission time, on the bottom too. `physical`: the current moves only aMussels
    that have left the bottom."""
    amplitude_m: Annotated[float, Ge(0), Le(100)] = 0.0
    """Half width of the uniform step that `paper` mode adds to north and to east each mission second."""
    current_file: str | None = None
    """A CSV with the columns north_m, east_m, north_m_s and east_m_s on a grid, or NetCDF; relative to the scenario
    file."""
    current_m_s: tuple[Speed, Speed] | None = None
    """(north, east) velocity of a current that is the same everywhere, instead of a file."""


SpreadDeviation = Annotated[float, Ge(0), Le(0.3)]
"""Draws are cut at three deviations, so that at least a tenth of the nominal is left."""


@frozen
class SpreadOptions:
    """Spread of the fleet's aMussels about their board's numbers: one standard deviation, relative. The draws follow
    from the scenario's seed; no estimator knows them."""

    drain: SpreadDeviation = 0.0
    """The spread of the boards' loads."""
    capacity: SpreadDeviation = 0.0
    """The spread of the batteries' capacity, the same for both of an aMussel: smaller ones drain and charge faster."""
    secondary_start: SpreadDeviation = 0.0
    """The spread of the distance below full at which a secondary battery starts, where no start states its charge."""
    drain_bias: Annotated[float, Ge(-0.5), Le(0.5)] = 0.0
    """All boards drain by so much more than their numbers say, relative: the planner and the estimators are wrong by it."""


@frozen
class FirmwareProgram:
    """Somebody's firmware on the aMussels' boards: docs/firmware-port.md."""

    executable: str
    """Relative to the scenario file; or `serial:DEVICE`, a real board on a serial line, for one aMussel at `theta: 1`."""
    arguments: tuple[str, ...] = ()
    """The program's arguments."""
    agents: tuple[AgentId, ...] = ()
    """The ids that it runs on; empty for all that no other firmware names."""


@frozen
class Fleet:
    count: Annotated[int, Ge(0), Le(20000)]
    """The number of aMussels. Leave it out with `first_id` where `start` names a file, to fly all of the file's
    aMussels."""
    first_id: AgentId = 1
    """The lowest id; the others rise from it. Two fleets on one master need ids of their own, or a namespace each:
    docs/ros-names.md."""
    agent_ids: tuple[AgentId, ...] = ()
    """The ids, rising, where they have gaps, such as [3, 7, 12, 24]; empty for `count` ids from `first_id` on. The loader
    takes these three from the file that `start` names if a scenario leaves `count` out. An aMussel's timeslot is its place
    among the ids, so gaps cost none."""
    start: Annotated[Annotated[RandomStart, Tag(VALUES)] | TheirFile, VALUES_OR_FILE] = "starts.csv"
    """`{charge: [low, high]}` for a random start; or the name of a CSV, or a former run's directory, relative to the
    scenario file (docs/scenarios.md#starts). From a run the loader takes the ends, or the starts if that run did not come
    to an end."""
    share: tuple[AgentId, ...] = ()
    """The ids that this aPad serves if it is one of several, as a run of several writes them; empty for all."""
    hosting: Hosting = Hosting.PROCESSES
    """`processes`: a process for each aMussel. `one_process`: all in the supervisor's, with the same trace."""
    drift: Drift
    """The random or physical motion of the aMussels in the water."""
    spread: SpreadOptions = SpreadOptions()
    firmware: tuple[FirmwareProgram, ...] = ()
    """A program on the boards in place of our firmware, or a list of several; a program's name alone stands for its
    `executable`: docs/firmware-port.md."""

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
    """The layout of the packets: ours, or one from a package of yours (docs/extending.md#codecs)."""


@frozen
class APadBattery:
    full_v: Positive
    """The terminal voltage when full."""
    empty_v: Positive
    """The terminal voltage when empty."""
    capacity_wh: Positive
    """Its capacity."""
    start_fraction: Fraction
    """Its charge at the start."""
    hotel_w: NotNegative
    """Computers and sensors, always."""
    charging_w_per_dock: NotNegative
    """For each aMussel that it charges. docs/energy.md#the-apad derives how much of it the batteries take in."""

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
    """With this part of its battery it goes on."""
    docked: DockedAtHome = DockedAtHome.CHARGE

    def __post_init__(self) -> None:
        if self.leave_at <= self.go_at:
            raise ValueError("leave_at must be above go_at, or it would go home again at once")


@frozen
class Unavailable:
    """A span of mission time in which the aPad takes up no plan and goes home."""

    from_s: NotNegativeSeconds
    """From then on it takes up no plan and goes home."""
    until_s: PositiveSeconds
    """Until then it stays."""

    def __post_init__(self) -> None:
        if self.until_s <= self.from_s:
            raise ValueError("until_s must be after from_s")


@frozen
class APad:
    """The simulated aPad. A real aPad needs its name, and its generation if it offers both."""

    profile: Literal["paper"] | None = None
    """Gives every missing key of the block: speeds, hull, thrusters and battery. The voltages are those of Fig. 4 (b), the
    rest is assumed."""
    name: RosNamespace = "apad1"
    """Its ROS namespace, below that of the run's nodes; `/apad1` is global, whatever theirs is."""
    generation: Generation = Generation.AUTO
    """The kind of its software: `a` has the action `action_server`, `b` services below `commander/primitive`; `auto` takes
    the one on the graph, and `a` for the simulated aPad (docs/apads.md)."""
    interface: str | None = None
    """A YAML file with the laboratory's own topics, relative to the scenario file (docs/apads.md#your-own-topics). None:
    musselbed's topics."""
    docks: Annotated[int, Ge(1), Le(MAX_DOCKS)] = PAPER_DOCKS
    """The number of its docking mechanisms, of a real aPad too; generation B can name 4 at most. Where on the hull they are
    follows from its software."""
    start_m: Place
    """Its place at the start."""
    max_speed_m_s: Positive
    """Its greatest speed through the water."""
    max_acceleration_m_s2: Positive
    """Its greatest acceleration."""
    max_yaw_rate_rad_s: Positive
    """Its greatest yaw rate."""
    mass_kg: Positive
    """Its mass."""
    drag_n_per_m2_s2: NotNegative
    """Quadratic drag: newtons at 1 m/s."""
    thruster_max_n: Positive
    """The greatest thrust of each of the four."""
    thruster_w_per_n: NotNegative
    """The power for a newton of thrust."""
    wind_n_per_m2_s2: NotNegative = 0.08
    """Quadratic drag in air: newtons of a wind of 1 m/s. Assumed: half of 1.2 kg/m3, times 0.8, times 0.17 m2 of hull."""
    drift_m_s: tuple[Speed, Speed] = (0.0, 0.0)
    """Velocity (north, east) of a drift that was measured with the controllers off, and acts then alone. A current or a
    wind of the scenario takes its place."""
    fault: Fault = Fault.NONE
    """The misbehaviour of the simulated aPad's ROS node (docs/failures.md#what-goes-wrong)."""
    dock_miss_probability: Fraction = 0.05
    """Probability that a docking misses in calm water; the scenario's seed decides which dockings do. Assumed; the paper's
    scenarios have 0."""
    battery: APadBattery
    """The battery."""
    home: Home | None = None
    """Its charger at home. None: the aPad is not charged, and goes home only when it is unavailable."""
    unavailable: tuple[Unavailable, ...] = ()
    """The spans of mission time that it spends at home."""

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
    """/amusselK/position and battery_level show the truth, as the published simulator does, and not the reports."""


@frozen
class Scenario:
    name: FileName
    """Letters, digits, dot, dash and underscore: run directories are named after it."""
    description: str = ""
    """For people; nothing reads it."""
    seed: Annotated[int, Ge(0), Le(2**63 - 1)]
    """Decides the random starts, the drift and every other chance: the same seed gives the same run."""
    duration_s: PositiveSeconds
    """The mission ends then, if nothing ends it before."""
    theta: Annotated[int, Ge(1), Le(1_000_000)]
    """The factor by which the aMussels' time runs faster than the aPad's; 1 for real ones."""
    time_stands_while_stopped: bool = False
    """While a person's stop is in force and the hull is at rest, mission time stands still; each order takes one second of
    it. For one simulated aPad on the run's own master."""
    area: Area
    """The waters, and where they lie."""
    fleet: Fleet
    """The aMussels."""
    board: BoardOptions
    sensors: tuple[str, ...] = tuple(BROUGHT)
    """The sensors that packages bring to its whole boards, as `salinity of lab_sensors 1.2`: those installed here. A run
    keeps the list, and is refused where others are installed."""
    hearing: Hearing
    """The reports of the aMussels."""
    mission: Mission
    """The paper's mission, and its rules."""
    apad: APad
    apads: tuple[AnotherAPad, ...] = ()
    """Further aPads, which share the fleet with `apad`."""
    sharing: Sharing = Sharing()
    records: Records = Records()
    """The records of the run."""
    beliefs: Beliefs = Beliefs()
    """The supervisor's estimate of the aMussels between their packets, on which the mission acts: docs/beliefs.md."""
    guards: GuardOptions | None = None
    """Limits of every order that moves the aPad or an aMussel, whoever gives it: docs/guards.md#guards. None, with a fence:
    the defaults. None, without one: the guards of an aPad that `musselbed` starts refuse impossible numbers, and orders
    while its position is not known."""
    faults: Faults | None = None
    """Faults of simulated aMussels and of the simulated aPad, which begin and heal at stated times: docs/faults.md. A real
    aPad refuses a scenario that has them."""
    water: Water | None = None
    """The water between the aMussels and the aPad, with its sound: docs/water.md. None: every packet arrives at once and
    whole, as in the paper's experiments. Use it with `hearing.mode: physical` and `board.whole`, whose boards transmit in
    timeslots."""

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
