"""A sea without losses of sound, and a fleet of whole boards in it, from which tests start."""

from __future__ import annotations

from dataclasses import replace

from fleets import STILL, reporting_every, with_whole_boards

from agents.water.sea import SeaConfig
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
