"""The scenario's block `mission`: whom the aPad collects and when, its dockings, and when the mission ends."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from annotated_types import Ge, Le

from agents.water.bounds import Count, NotNegative
from apad_bridge.planning.dispatch_rule import ServiceRules
from apad_bridge.scenario.quantities import (
    AgentId,
    EndTime,
    Fraction,
    NotNegativeSeconds,
    Positive,
    PositiveSeconds,
    frozen,
)


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
    """The yaw rate while the vehicle sees nothing."""
    max_yaw_rate_rad_s: Positive
    """The largest yaw rate while it approaches."""
    max_surge_m_s: Positive
    """The largest speed while it approaches."""
    surge_stdev: Positive
    """Standard deviation of the target's horizontal place in the image (half the image's width is 1). The vehicle
    approaches the slower, the farther the target is off the centre."""
    search_s: PositiveSeconds
    """A docking is given up if it has not ended this long after the vehicle accepted the order."""


@frozen
class Docking:
    profile: DockingProfile
    """docs/apads.md#docking."""
    virtual_ids: tuple[AgentId, ...] = ()
    """The aMussels that are docked by `virtual`, whatever `profile` says."""
    camera_ids: tuple[AgentId, ...] = ()
    """The aMussels that are docked by `camera`, likewise."""
    visual_ids: tuple[AgentId, ...] = ()
    """The aMussels that are docked by `visual`, likewise."""
    dock_s: NotNegativeSeconds
    """The time before the mechanism closes, in `virtual`."""
    undock_s: NotNegativeSeconds
    """The time before the mechanism opens, in `virtual`."""
    timeout_s: PositiveSeconds
    """A docking that lasts longer has failed; longer than `dock_s`, `undock_s` and `servo.search_s`."""
    attempts: Annotated[int, Ge(1), Le(10)] = 1
    """The number of tries before the mission gives the aMussel up for this time; the summary counts further tries under
    `dropped`."""
    catch_radius_m: Positive = 0.5
    """A virtual docking catches an aMussel that floats no farther than this from the aPad, which otherwise searches for it.
    Assumed: the mechanisms stand 0.4 m from its middle. The paper's scenarios have 3, because there a docking cannot
    fail."""
    arm: ArmUse = ArmUse.ALONE
    servo: Servo | None = None
    """The parameters of `camera` and `visual` with generation B."""

    def __post_init__(self) -> None:
        if self.timeout_s <= max(self.dock_s, self.undock_s):
            raise ValueError("timeout_s must be longer than dock_s and undock_s")
        listed_ids = (*self.virtual_ids, *self.camera_ids, *self.visual_ids)
        if len(set(listed_ids)) < len(listed_ids):
            raise ValueError("virtual_ids, camera_ids and visual_ids must not name an aMussel twice")
        if self.servo is not None and self.timeout_s <= self.servo.search_s:
            raise ValueError("timeout_s must be longer than servo.search_s")

    @property
    def longest_s(self) -> float:
        """A docking has ended after this time, with all its tries."""
        return self.attempts * self.timeout_s

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
    """The weight of the way in a plan's cost."""
    energy_per_charge: NotNegative = 1.0
    """The weight of the charging demand, a whole battery of it."""
    flow: bool = True
    """The scenario's current and wind count in the way's cost, by the energy that it then takes, and in its time
    (docs/water.md#the-apad-in-current-and-wind). False: the way over ground alone."""


class Suspects(StrEnum):
    """The treatment of an aMussel whose packets contradict physics: people are told of it in any case.

    `asked`: the aPad asks it for its status by sound, from time to time. `fetched`: it is collected once, for a look.
    """

    TOLD = "told"
    ASKED = "asked"
    FETCHED = "fetched"


@frozen
class Strategies:
    """The strategies of a mission. In a written file, and in a list of mistakes, they come before its rules."""

    collection: str
    """Name of a collection strategy: one of docs/studies.md#strategies, one from a user's package, or `FILE.py:Class`
    (docs/first-strategy.md)."""
    redeployment: str = "greedy-redeploy"
    """Name of a redeployment strategy, likewise."""


@frozen
class Mission(ServiceRules, Strategies):
    speed_m_s: Positive
    """The speed of the aPad's go-tos."""
    victory_radius_m: Positive
    """The distance from a goal that counts as an arrival."""
    docking: Docking
    """The dockings."""
    costs: Costs = Costs()
    end_at_apad_fraction: Fraction = 0.0
    """The mission ends when the aPad's battery falls to this."""
    end_by: EndTime | None = None
    """The mission is home by then: a local time as 16:30, or seconds of mission time. In good time it stops collecting,
    brings back the docked aMussels, goes to `area.home_m`, holds there and ends. It reserves these ways at 0.8 of
    `speed_m_s`, `docking.timeout_s` for each undocking, and a minute. The loader refuses a local time that has passed
    today. Scripts and `--manual` ignore the key."""
    permission_repeat_s: PositiveSeconds
    """The mission repeats an unanswered permission to surface after this time."""
    surfacing_attempts: Count
    """The mission gives the aMussel up for this time after this number of permissions."""
    silence_timeout_s: PositiveSeconds
    """The mission stops waiting for an aMussel that has been silent for this long, and goes on without it."""
    collection_attempts: Count = 5
    """The mission leaves an aMussel alone after so many tries in a row that did not help it."""
    suspects: Suspects = Suspects.TOLD
    """docs/beliefs.md#suspects. `asked` and `fetched` need `beliefs.estimator: twin`, and `asked` also `water` and
    `board.whole`; it asks each ten minutes of agent time."""
