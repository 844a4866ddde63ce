"""What an aPad of generation B says, as facts; what the port commands, as orders. No ROS in here, and no clock.

That stack answers at once and tells the end by topics that name no order; nothing in it has a time-out; and every end
leaves the controllers off. So here each order has its tries and its time-outs, a vehicle that dropped one is noticed,
and whatever ends is followed by dynamic positioning. While a pilot steers nothing is ordered.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping

from apad_bridge.laboratory.words import DockSaid
from apad_bridge.ros.generation_b_calls import Calls
from apad_bridge.ros.generation_b_docking import ServoDocking
from apad_bridge.ros.generation_b_docks import DocksByBench
from apad_bridge.ros.generation_b_going import Going
from apad_bridge.ros.generation_b_hand import HandDocking
from apad_bridge.ros.generation_b_words import (
    Answered,
    ArmHeard,
    Call,
    FinishedHeard,
    Heard,
    PilotHeard,
    PositionOrder,
    Status,
    StatusHeard,
)
from apad_bridge.ros.legacy_words import BatteryHeard, PoseHeard, StateHeard
from apad_bridge.ros.reach import Sight
from apad_bridge.ros.readings import Readings
from apad_bridge.ros.silence_watch import SilenceWatch
from apad_bridge.scenario.schema import Docking, DockingProfile
from apad_bridge.simulated_apad.misses import Misses
from apad_bridge.vehicle import (
    Arrived,
    CloseDock,
    CommandFailed,
    GoTo,
    Hold,
    MoveArm,
    OpenDock,
    PoseReported,
    VehicleCommand,
)
from apad_bridge.vehicle_link import LinkFact

ASTRAY_M = 3.0
"""A vehicle that shall hold and is this far away does not."""
ASTRAY_MS = 10_000
"""So often, at most, it is told again."""
NOTHING_THERE = "the aPad says it docked, but the aMussel is not there"
PILOT = "a pilot steers the aPad"


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
        self.calls = Calls()
        self.state_ms = -1
        """The newest stamp of `stateRef`."""
        self.status_words = 0
        """How many words were heard of either status."""
        self._dropped: Counter[str] = Counter()
        self._docking = docking
        self._now_ms = now_ms
        self._later: list[Heard] = []
        self._facts: list[LinkFact] = []
        self._pose: PoseReported | None = None
        self._going: Going | None = None
        self._servo: ServoDocking | None = None
        self._hold_m: tuple[float, float] | None = None
        """Where the vehicle was told to hold, when nothing else is under way."""
        self._hold: Hold | None = None
        self._astray_ms = now_ms
        self._goal_m: tuple[float, float] | None = None
        """Where the last go-to led: there the aMussel was believed to be."""
        self._pilot_steers = False
        self._silence = SilenceWatch()
        self._hand = HandDocking()

    @property
    def dropped(self) -> Counter[str]:
        """Words of the vehicle that were of no use, by reason."""
        return self.readings.dropped + self.docks.dropped + self._hand.dropped + self._dropped

    @property
    def unanswered(self) -> list[str]:
        return self.calls.unanswered

    def unheard(self, now_ms: int) -> list[str]:
        return ["position"] if self.readings.position_ms < now_ms else []

    def take_calls(self) -> list[Call]:
        return self.calls.take()

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        if self._servo is not None and self._servo.has_let_go and not isinstance(command, MoveArm):
            self._servo.waits = command
            return
        match command:
            case GoTo(_, north_m, east_m):
                self._begin(going=Going(command))
                self._goal_m = (north_m, east_m)
                self._go(now_ms)
            case Hold(_, north_m, east_m, heading_rad):
                self._begin(hold=command)
                self._position((north_m, east_m), now_ms, heading_rad)
            case MoveArm():  # the link's: nothing is answered
                pass
            case CloseDock(_, _, agent_id) | OpenDock(_, _, agent_id):
                profile = self._docking.profile_of(agent_id)
                if profile is DockingProfile.VIRTUAL:
                    self._facts += self._act_at_once(command, now_ms)
                else:
                    self._begin_servo(command, now_ms)

    def hear(self, heard: Heard, now_ms: int) -> None:
        """What is stamped after `now_ms` waits for its time."""
        if heard.at_ms > now_ms and not isinstance(heard, StateHeard):
            self._later.append(heard)
            return
        match heard:
            case PoseHeard():
                self.readings.hear_pose(heard)
                self._pose = self.readings.pose
            case StateHeard(at_ms):
                self.state_ms = max(self.state_ms, at_ms)
            case BatteryHeard():
                self.readings.hear_battery(heard)
            case Answered():
                self.calls.hear(heard)
            case StatusHeard(at_ms, docking, status):
                self._hear_status(docking, status, at_ms)
            case PilotHeard(at_ms, steers):
                self._hear_pilot(steers, at_ms)
            case ArmHeard(at_ms, slot) if slot is not None:
                self._hear_arm(slot, at_ms)
            case ArmHeard() | FinishedHeard():
                pass  # a closed arm, or some primitive's end: the statuses tell what came of it

    def advance(self, now_ms: int) -> list[LinkFact]:
        """Facts not told before, each stamped at or before `now_ms`; poses and places are the newest only."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back from {self._now_ms} to {now_ms} ms")
        self._now_ms = now_ms
        later, self._later = self._later, []
        for heard in later:
            self.hear(heard, now_ms)
        if not self._pilot_steers:
            self._watch_silence(now_ms)
            self._watch_all(now_ms)
        facts, self._facts = self._facts, []
        return [*facts, *self.docks.places(self._pose, now_ms), *self.readings.take()]

    def _watch_silence(self, now_ms: int) -> None:
        """A vehicle that is heard again after a silence may have been rebooted: it is told again what it was doing."""
        changed = self._silence.look(self.readings.position_ms, now_ms)
        if changed is None or changed.is_silent:
            return
        if self._going is not None:
            self._begin(going=Going(self._going.command))
            self._go(now_ms)
        elif self._servo is None and self._hold_m is not None:
            self._position(self._hold_m, now_ms)

    # Going and holding.

    def _begin(self, *, going: Going | None = None, hold: Hold | None = None) -> None:
        self._going, self._hold, self._servo, self._hold_m = going, hold, None, None

    def _go(self, now_ms: int) -> None:
        if self._going is None:
            return
        if (order := self._going.order) is None:
            self._fail("the aPad aborts a go-to without a speed, a victory radius or a finite goal", now_ms)
        elif not self._pilot_steers:
            self.calls.order(order, now_ms)

    def _position(self, place_m: tuple[float, float], now_ms: int, heading_rad: float | None = None) -> None:
        self._hold_m, self._astray_ms = place_m, now_ms
        if not self._pilot_steers:
            self.calls.order(PositionOrder(*place_m, heading_rad), now_ms)

    def _hold_here(self, now_ms: int) -> None:
        """Whatever ended left the controllers off."""
        if self._pose is not None:
            self._position((self._pose.north_m, self._pose.east_m), now_ms)

    def _hear_status(self, docking: bool, status: Status, at_ms: int) -> None:
        self.status_words += 1
        pending = self.calls.pending
        answered = pending is not None and pending.answered_ms is not None
        if docking:
            if self._servo is None:
                word = self._hand.hear(status, at_ms, self.docks.held)
                self._facts += [] if word is None else self.docks.take_word(word, self._pose)
            elif self._servo.hear(status, at_ms, answered=answered):
                self._servo_done(self._servo, at_ms)
        elif self._going is not None and self._going.hear(status, at_ms, self._pose, answered=answered):
            if self._going.is_near(self._pose):
                self._arrive(self._going.command, at_ms)
            else:
                distance_m = self._going.distance_m(self._pose)
                self._fail(f"the aPad says it arrived, {distance_m:.1f} m from the goal", at_ms)

    def _arrive(self, command: GoTo, at_ms: int) -> None:
        self._facts.append(Arrived(at_ms, command.command_id))
        self._begin()
        self._position((command.north_m, command.east_m), at_ms)

    def _watch_all(self, now_ms: int) -> None:
        if (cause := self.calls.failed(now_ms)) is not None:
            if self._going is None and self._servo is None and self._hold is None:
                self._dropped[f"hold after the end of a primitive: {cause}"] += 1
                self._astray_ms = now_ms
            else:
                self._fail(cause, now_ms)
        if self._going is not None:
            self._watch_going(self._going, now_ms)
        elif self._servo is not None:
            self._watch_servo(self._servo, now_ms)
        elif self._hold_m is not None and self._is_astray(self._hold_m, now_ms):
            self._dropped["the aPad did not hold its position, and was told again"] += 1
            self._position(self._hold_m, now_ms)

    def _is_astray(self, hold_m: tuple[float, float], now_ms: int) -> bool:
        if self._pose is None or now_ms - self._astray_ms < ASTRAY_MS:
            return False
        return math.dist(hold_m, (self._pose.north_m, self._pose.east_m)) > ASTRAY_M

    def _watch_going(self, going: Going, now_ms: int) -> None:
        if (why := going.why_lost(now_ms)) is not None:
            self._fail(why, now_ms)
        elif going.has_arrived_unsaid(self._pose, now_ms):
            self._dropped["goto_status was silent: arrival by position"] += 1
            self._arrive(going.command, now_ms)

    @property
    def _under_way(self) -> GoTo | CloseDock | OpenDock | None:
        if self._going is not None:
            return self._going.command
        return None if self._servo is None else self._servo.command

    def _fail(self, reason: str, at_ms: int) -> None:
        """The command under way has failed; the vehicle is held where it is."""
        command = self._under_way or self._hold
        if command is not None:
            self._facts.append(CommandFailed(at_ms, command.command_id, reason))
        self._begin()
        self._hold_here(at_ms)

    # Docking.

    def _act_at_once(self, command: CloseDock | OpenDock, now_ms: int) -> list[LinkFact]:
        """Virtual: the port has waited out the time, and the bench makes the contact."""
        if isinstance(command, OpenDock):
            return self.docks.open(command, now_ms)
        return self.docks.close(command, self._pose, now_ms)

    def _begin_servo(self, command: CloseDock | OpenDock, now_ms: int) -> None:
        refused = self.docks.refusal(command) if isinstance(command, CloseDock) else None
        if self._docking.servo is None:
            refused = "mission.docking.servo is missing in the scenario"
        if refused is not None or self._docking.servo is None:
            self._facts.append(CommandFailed(now_ms, command.command_id, refused or ""))
            return
        self._begin()
        self._servo = ServoDocking(command, self._docking.servo, self._pose, self._goal_m, now_ms)
        if not self._pilot_steers:
            self.calls.order(self._servo.first_order, now_ms)

    def _watch_servo(self, servo: ServoDocking, now_ms: int) -> None:
        pending = self.calls.pending
        answered_ms = None if pending is None else pending.answered_ms
        order = servo.next_order(self._pose, answered_ms, now_ms)
        if order is not None:
            self.calls.order(order, now_ms)
        elif (why := servo.why_over(answered_ms, now_ms)) is not None and servo.has_let_go:
            self._servo_done(servo, now_ms)
        elif why is not None:
            self._fail(why, now_ms)

    def _servo_done(self, servo: ServoDocking, at_ms: int) -> None:
        if isinstance(servo.command, CloseDock):
            if self.docks.is_out_of_reach(servo.command, self._pose, at_ms):
                self._fail(NOTHING_THERE, at_ms)
                return
            if not self.docks.holds(servo.command.agent_id):
                self._facts += self.docks.close(servo.command, self._pose, at_ms)
        elif not servo.has_let_go:
            self._facts += self.docks.open(servo.command, at_ms)
        self._begin()
        self._go_on(servo, at_ms)

    def _go_on(self, servo: ServoDocking, at_ms: int) -> None:
        if servo.waits is None:
            self._hold_here(at_ms)
        else:
            self.command(servo.waits, at_ms)

    def _hear_arm(self, slot: int, at_ms: int) -> None:
        self._hand.see_arm(slot)
        servo = self._servo
        if servo is None or servo.has_let_go or not isinstance(servo.command, OpenDock):
            return
        if servo.command.slot == slot:
            servo.has_let_go = True
            self._facts += self.docks.open(servo.command, at_ms)

    def hear_dock(self, word: DockSaid) -> None:
        """Somebody says what a dock did. By id; of none, by slot and place. What is known already is no news."""
        self._facts += self.docks.take_word(word, self._pose)

    def _hear_pilot(self, steers: bool, at_ms: int) -> None:
        """A pilot is never fought: what was under way has failed, and nothing is ordered until the sticks are let go."""
        if steers == self._pilot_steers:
            return
        self._pilot_steers = steers
        if steers:
            self.calls.forget()
            if (command := self._under_way) is not None:
                self._facts.append(CommandFailed(at_ms, command.command_id, PILOT))
                self._begin()
        elif self._going is not None:
            self._go(at_ms)
        elif self._servo is not None:
            self.calls.order(self._servo.first_order, at_ms)
        elif self._hold is not None:
            self._position((self._hold.north_m, self._hold.east_m), at_ms, self._hold.heading_rad)
        else:
            self._hold_here(at_ms)
