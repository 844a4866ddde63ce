"""A sea without losses of sound, and a fleet of whole boards in it, from which tests start."""

from __future__ import annotations

from dataclasses import replace

from fleets import PAPER, STILL

from agents.water.places import Sinking
from agents.water.sea import SeaConfig
from agents.water.sound import Sound
from firmware_model.config import FullFirmware
from firmware_model.table_one import FIELD, MODEL, power

SEA = SeaConfig(
    seed=3,
    sound=Sound(noise_db_per_hz=-100),
    wifi=None,
    sinking=Sinking(3_000_000, 60_000, 45_000),
    keel_um=3_000_000,
    range_noise_m=0.0,
    thrusting_m_s=0.1,
)
FLEET = replace(
    PAPER,
    theta=1,
    charge=MODEL,
    report_period_ms=600_000,
    whole=FullFirmware(power(), FIELD, 1000, 60_000, 600_000),
    **STILL,
)
