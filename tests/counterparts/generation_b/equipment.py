"""What hangs on the boat: camera mailbox, four dock arms with their switches and coils, battery."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable
from dataclasses import dataclass

SLOTS = 4  # paper II: "four mechanical docking stations housing inductive transmitter coils"
ARM_SECONDS = 1.5  # vehicle seconds an arm takes from one end to the other
CONTACT_MEMORY = 5.0  # vehicle seconds: a body in the mouth of the dock when the arm began to close
VERTICAL_BAND = (0.8, 0.9)  # facts B: a docking succeeds when docking_vertical lies in (0.8, 0.9)
COIL_SHARE = 0.15  # what one coil draws, as a share of the idle load
EMPTY_VOLT, FULL_VOLT = 10.5, 16.0  # paper fig. 4 (b): aPad battery, operating range [16, 10.5] V


class Camera:
    """The newest message of each topic the docking primitive listens to (facts B).

    Subscribers put values in with `receive`; the worker takes them out with `take` and stamps them then, as a
    single-threaded node with queues of one would: Float32 has no stamp, so after the 27 s servo block the last
    message of the block counts as new.
    """

    def __init__(self) -> None:
        self._mail: dict[str, float] = {}
        self._seen: dict[str, tuple[float, float]] = {}

    def receive(self, topic: str, value: float) -> None:
        """Called by a subscriber's thread."""
        self._mail[topic] = value

    def take(self, now: float) -> None:
        """Called by the worker: what has come in since counts as seen at vehicle time `now`."""
        mail, self._mail = self._mail, {}
        for topic, value in mail.items():
            self._seen[topic] = (value, now)

    def value(self, topic: str, now: float, younger: float = 1.0) -> float | None:
        """The topic's value if it was seen less than `younger` seconds ago."""
        value, when = self._seen.get(topic, (0.0, -1e9))
        return value if now - when < younger else None

    def manual(self) -> bool:
        """Whether a pilot has the stick (facts B: "Pilots take over with a joystick (`manual`)")."""
        return bool(self._seen.get("manual", (0.0, 0.0))[0])

    def contact(self, now: float) -> bool:
        """Whether something stood in the dock's mouth within the last few seconds."""
        low, high = VERTICAL_BAND
        return low < (self.value("docking_vertical", now, CONTACT_MEMORY) or 0.0) < high


@dataclass
class Arm:
    """One dock: `opening` from 0 (closed) to 1 (open), its switch and its motor's stall flag."""

    opening: float = 0.0
    wanted: bool = False
    switch: bool = False
    held: bool = False  # something was held when the arm last began to open
    jam: bool = False  # drawn: this closing will stall
    jammed: bool = False
    catch: bool = False  # drawn: this closing will press the switch


class Docks:
    """The arm driver: follows `dock_out` (1.0 open, 0.0 closed; facts B), whoever publishes it."""

    def __init__(
        self, camera: Camera, failures: float, kind: str, rng: random.Random, now: Callable[[], float]
    ) -> None:
        self._lock = threading.Lock()
        self.arms = [Arm() for _ in range(SLOTS)]
        self.camera, self.failures, self.kind, self.rng, self.now = camera, failures, kind, rng, now

    def command(self, values: list[float]) -> None:
        """A message of `dock_out`: shorter ones leave the missing slots as they are."""
        with self._lock:
            for arm, value in zip(self.arms, values, strict=False):
                if (value > 0.5) != arm.wanted:
                    arm.wanted = value > 0.5
                    self._open(arm) if arm.wanted else self._close(arm)

    def _open(self, arm: Arm) -> None:
        arm.held, arm.jam, arm.jammed, arm.catch = arm.switch, False, False, False

    def _close(self, arm: Arm) -> None:
        contact = self.camera.contact(self.now())
        fails = not arm.held and self.rng.random() < self.failures
        arm.jam = fails and self.kind == "jam"
        arm.catch = contact and not fails

    def step(self, dt: float) -> None:
        """Move the arms for dt vehicle seconds."""
        with self._lock:
            for arm in self.arms:
                change = dt / ARM_SECONDS
                if arm.wanted:
                    arm.opening = min(1.0, arm.opening + change)
                    arm.switch = arm.switch and arm.opening < 1.0
                elif arm.jam and arm.opening <= 0.5:
                    arm.jammed = True
                elif arm.opening > 0.0:
                    arm.opening = max(0.0, arm.opening - change)
                    if arm.opening == 0.0:
                        arm.switch, arm.held = arm.switch or arm.catch, False

    def coils(self) -> int:
        """How many coils draw power: one for every closed arm with its switch pressed."""
        return sum(arm.switch and arm.opening == 0.0 for arm in self.arms)


class Battery:
    """State of charge in percent; idle empties it in `idle_hours`, thrusters flat out in a third of that."""

    def __init__(self, percent: float, idle_hours: float) -> None:
        self.percent, self.idle_hours = percent, idle_hours

    def step(self, dt: float, thrust_load: float, coils: int) -> None:
        """Drain for dt vehicle seconds at a thrust load of 0 to 1 and so many coils switched on."""
        share = 1.0 + 2.0 * thrust_load + COIL_SHARE * coils
        self.percent = max(0.0, self.percent - 100.0 * share * dt / (3600.0 * self.idle_hours))

    def volt(self) -> float:
        """Terminal voltage, linear over the paper's operating range."""
        return EMPTY_VOLT + (FULL_VOLT - EMPTY_VOLT) * self.percent / 100.0
