"""A sea without losses of sound, and a fleet of whole boards in it, from which tests start."""

from __future__ import annotations

from dataclasses import replace

from fleets import STILL, reporting_every, with_whole_boards

from agents.coordinator import Coordinator
from agents.fleet_config import FleetConfig, resting_on_bottom
from agents.hosting.in_process import InProcessHost
from agents.time_scale import MissionMs
from agents.water.sea import Sea, SeaConfig
from agents.water.sea_events import SeaResult
from agents.water.sound import Sound
from firmware_model.config import FullFirmware
from firmware_model.table_one import FIELD, power

SEA = SeaConfig(
    seed=3,
    sound=Sound(absorption_db_per_km=6.0, noise_db_per_hz=-100, keel_m=3.0, range_noise_m=0.0),
    wifi=None,
    sinking=STILL.body.sinking,
)
FLEET = with_whole_boards(
    reporting_every(replace(STILL, theta=1), 600_000), FullFirmware(power(), FIELD, 1000, 60_000, 600_000)
)


class SeaBench:
    """aMussels 1, 2, ... on the bottom at these metres to the north; the aPad's modem as deep, at 0."""

    def __init__(
        self, *norths_m: float, sea: SeaConfig = SEA, fleet: FleetConfig = FLEET, opened: tuple[int, ...] = ()
    ) -> None:
        states = {n: resting_on_bottom(it, 0, 3.0, 0.9, 1.0) for n, it in enumerate(norths_m, start=1)}
        self.host = InProcessHost(fleet, states)
        self.coordinator = Coordinator(self.host, dict.fromkeys(states, 0), fleet.time_scale)
        self.sea = Sea(sea, fleet.time_scale, states, opened=opened).join(self.coordinator, self.host)
        self.sea.carry_apad(0.0, 0.0, 0)
        self.now_ms = 0
        self.came: list[SeaResult] = []

    def run(self, until_ms: int, step_ms: int = 1000) -> list[SeaResult]:
        """What has come at the steps until then."""
        new: list[SeaResult] = []
        while self.now_ms + step_ms <= until_ms:
            self.now_ms += step_ms
            if self.coordinator.scale.agent_ms(MissionMs(self.now_ms)) >= self.sea.now_ms:
                new += self.sea.advance(MissionMs(self.now_ms))
        self.came += new
        return new
