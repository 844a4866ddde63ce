"""A vehicle's numbers from its logs: each with its interval, as a scenario's keys; and what a log cannot tell, and why."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass, field
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np

from apad_bridge.field.calibration.apad_energy import EnergyFigures, energy_of
from apad_bridge.field.calibration.intervals import Figure, mean, share
from apad_bridge.field.calibration.losses import Loss, by_range, of_sound, of_wifi
from apad_bridge.field.calibration.reflight import Reflown, refly
from apad_bridge.field.calibration.speed_and_drift import LEAST_LEG_M, FlownLeg, drifts_m_s, legs_of
from apad_bridge.field.calibration.stopping import LEAST_STOPS, stopping_distance
from apad_bridge.field.field_log.log_facts import LoggedFact, Work
from apad_bridge.field.field_log.reader import facts_of
from apad_bridge.field.field_log.vehicle_log import VehicleLog, vehicle_log
from apad_bridge.scenario.firmware_config import codec_of
from apad_bridge.scenario.loader import from_data, resolve
from apad_bridge.scenario.schema import Scenario

_DIGITS = 4
_MISFIT = 0.035
"""A share of a leg's length. Waves of 0.3 m misfit by 0.03 on 6 m, and a vehicle that slows all the way by 0.04 to 0.09."""
_RESIDUAL = 0.25
"""A share of a go-to's time."""
_AT_ONCE_S = 0.5
"""Generation A's published server answers a perch without waiting for a mechanism."""
Spans = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Residuals:
    """Go-tos flown by the vehicle and by the simulated aPad with the new numbers: real minus simulated."""

    go_tos: int
    seconds: Figure | None
    """The mean difference of a go-to's time."""
    rms_s: float | None
    mean_go_to_s: float | None
    """The vehicle's own mean time, to compare with."""


@dataclass(slots=True)
class Calibration:
    """`figures` by name; `unmeasured` gives the reason by name; `block` holds the scenario's keys that follow."""

    figures: dict[str, Figure] = field(default_factory=dict)
    unmeasured: dict[str, str] = field(default_factory=dict)
    sound: list[Loss] = field(default_factory=list)
    wifi: list[Loss] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    block: dict[str, Any] = field(default_factory=dict)
    residuals: Residuals | None = None

    def to_json(self) -> dict[str, Any]:
        return {
            "figures": {name: asdict(it) for name, it in self.figures.items()},
            "unmeasured": self.unmeasured,
            "loss_of_sound": [asdict(it) for it in self.sound],
            "loss_of_wifi": [asdict(it) for it in self.wifi],
            "notes": self.notes,
            "scenario": self.block,
            "residuals": None if self.residuals is None else asdict(self.residuals),
        }


@dataclass(frozen=True, slots=True)
class ReadBag:
    """A bag as read: its log, and its facts for what the log leaves out."""

    log: VehicleLog
    facts: list[LoggedFact]


def read_recording(path: Path, apad: str, namespace: str = "") -> ReadBag:
    """BagUnreadable, one line, for a bag that cannot be read or has nothing of this aPad."""
    facts, missing = facts_of(path, apad, namespace)
    return ReadBag(vehicle_log(str(path), facts, missing), facts)


def calibrate(
    recordings: Sequence[ReadBag],
    scenario: Scenario,
    adrift_s: Spans = (),
    flown_with_it: Sequence[ReadBag] = (),
) -> Calibration:
    """Measures all that the recordings tell. `scenario` gives what no log has: the battery's capacity, mass and drag.

    `adrift_s` are spans by the recorder's clock in which the controllers were off. The residuals are those of
    `flown_with_it`, or of the recordings themselves.
    """
    found = Calibration()
    logs = [it.log for it in recordings]
    found.notes += [line for log in logs for line in log.missing]
    _motion(found, logs, [leg for log in logs for leg in legs_of(log)], scenario.apad.max_speed_m_s)
    _docking(found, logs)
    _drift(found, logs, adrift_s)
    moved = with_block(scenario, found.block)
    flown = [(log, _reflown(log, moved)) for log in logs]
    own = _residuals([it for _, its in flown for it in its])
    if own.rms_s is not None and own.mean_go_to_s is not None and own.rms_s > _RESIDUAL * own.mean_go_to_s:
        reason = (
            f"flown again, go-tos differ by {own.rms_s:.1f} s (root mean square) of {own.mean_go_to_s:.1f} s"
        )
        _withdraw_motion(found, reason)
    _energy(found, flown, scenario)
    _losses(found, recordings, scenario)
    others = [_reflown(it.log, moved) for it in flown_with_it]
    found.residuals = _residuals([it for each in others for it in each]) if others else own
    found.unmeasured["leeway"] = (
        "water.wind.leeway: no message of either generation has the wind, and one wind cannot be told from a current"
    )
    return found


def with_block(scenario: Scenario, block: dict[str, Any]) -> Scenario:
    """The scenario with a calibration's keys. ScenarioError where they contradict others."""
    return from_data(_merged(resolve(scenario), block), "calibrated")


def _merged(data: dict[str, Any], block: dict[str, Any]) -> dict[str, Any]:
    merged = deepcopy(data)
    for key, value in block.items():
        inner = merged.get(key)
        merged[key] = _merged(inner, value) if isinstance(value, dict) and isinstance(inner, dict) else value
    return merged


def _note(found: Calibration, name: str, figure: Figure | None, reason: str) -> Figure | None:
    if figure is None:
        found.unmeasured[name] = reason
    else:
        found.figures[name] = figure
    return figure


def _put(found: Calibration, value: float | list[float], *path: str) -> None:
    block = found.block
    for key in path[:-1]:
        block = block.setdefault(key, {})
    block[path[-1]] = [_rounded(it) for it in value] if isinstance(value, list) else _rounded(value)


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


def _motion(found: Calibration, logs: list[VehicleLog], legs: list[FlownLeg], max_speed_m_s: float) -> None:
    if not any(len(log.track) for log in logs):
        for name in ("speed", "stopping distance"):
            found.unmeasured[name] = "no position of the aPad in the bags"
        return
    too_few = f"fewer than three completed go-tos of {LEAST_LEG_M:g} m or more with a cruise"
    speed = _note(found, "speed", mean([it.speed_m_s for it in legs], "m/s"), too_few)
    if legs and (misfit := float(np.median([it.misfit_m / it.length_m for it in legs]))) > _MISFIT:
        reason = f"the ways differ from that by {100 * misfit:.0f} % of their length"
        _withdraw_motion(found, reason)
        return
    if speed is None:
        found.unmeasured["stopping distance"] = too_few
        return
    _put(found, speed.value, "mission", "speed_m_s")
    if speed.value > max_speed_m_s:
        _put(found, speed.value, "apad", "max_speed_m_s")
    stops = [it.stop for it in legs if it.stop is not None]
    too_seldom = "positions come too seldom to show a braking: record the vehicle's own, at 4 Hz or more"
    hidden = "the positions' noise hides the braking: more go-tos, or a better fix"
    stopping = _note(
        found,
        "stopping distance",
        stopping_distance(stops),
        too_seldom if len(stops) < LEAST_STOPS else hidden,
    )
    if stopping is not None:
        _put(found, speed.value**2 / (2 * stopping.value), "apad", "max_acceleration_m_s2")


def _withdraw_motion(found: Calibration, reason: str) -> None:
    """Takes back the figures of a vehicle that neither accelerates evenly, cruises nor brakes evenly, and their keys."""
    for name in ("speed", "stopping distance"):
        found.figures.pop(name, None)
        found.unmeasured[name] = (
            f"does not fit: {reason}. The vehicle has no cruise speed that the simulated aPad could have: "
            "docs/guards.md#a-vehicle-without-a-cruise-speed"
        )
    for block, key in (
        ("mission", "speed_m_s"),
        ("apad", "max_speed_m_s"),
        ("apad", "max_acceleration_m_s2"),
    ):
        found.block.get(block, {}).pop(key, None)


def _docking(found: Calibration, logs: list[VehicleLog]) -> None:
    for name, work, key in (
        ("docking time", Work.DOCK, "dock_s"),
        ("undocking time", Work.UNDOCK, "undock_s"),
    ):
        took_s = [it.ended_s - it.began_s for log in logs for it in log.of(work) if it.is_done]
        if len(took_s) >= 3 and max(took_s) < _AT_ONCE_S:
            found.unmeasured[name] = (
                "the stack answers at once, so its answer has nothing of the mechanism's time"
            )
            continue
        figure = _note(
            found, name, mean(took_s, "s", resolution=1.0), f"fewer than three {name[:-5]}s in the bags"
        )
        if figure is not None:
            _put(found, round(figure.value, 2), "mission", "docking", key)
    tries = [it for log in logs for it in log.tries if it.is_done or it.missed]
    reason = "no docking in the bags whose result anybody tells: generation B's own stack never says whether it caught one"
    misses = _note(found, "dockings missed", share(sum(it.missed for it in tries), len(tries)), reason)
    if misses is not None:
        _put(found, misses.value, "apad", "dock_miss_probability")


def _drift(found: Calibration, logs: list[VehicleLog], adrift_s: Spans) -> None:
    drifts = [it for log in logs for it in drifts_m_s(log, adrift_s)]
    reason = (
        "fewer than three spans of half a minute with the controllers off: let it drift for two minutes, and name the "
        "span by --adrift; generation B also drifts in its own dockings"
    )
    north = _note(found, "drift north", mean([it for it, _ in drifts], "m/s"), reason)
    east = _note(found, "drift east", mean([it for _, it in drifts], "m/s"), reason)
    if north is not None and east is not None:
        _put(found, [north.value, east.value], "apad", "drift_m_s")


def _energy(found: Calibration, flown: list[tuple[VehicleLog, list[Reflown]]], scenario: Scenario) -> None:
    levels = [log.battery.fractions for log, _ in flown if len(log.battery.fractions)]
    energy = energy_of(flown, scenario.apad.battery.capacity_wh)
    if not levels:
        reason = "no battery level in the bags"
    elif not any(np.ptp(it) for it in levels):
        energy = EnergyFigures(None, None, None, None)
        reason = f"the battery's level never moved from {100 * float(levels[0][0]):g} %"
    else:
        reason = "too few minutes of battery levels, or ways and rests that cannot be told apart"
    rest = _note(found, "power at rest", energy.rest_w, reason)
    _note(found, "energy per metre", energy.per_metre_wh, reason)
    fits = "does not fit" not in found.unmeasured.get("speed", "")
    thrust = _note(
        found,
        "power per thrust",
        energy.per_newton_w if fits else None,
        reason if fits else "the vehicle's motion does not fit, so the thrust of its ways is not known",
    )
    no_docks = reason if rest is None else "the bags do not tell when docks held aMussels"
    dock = _note(found, "power per dock", energy.dock_w, no_docks)
    keys = (
        (rest, "battery", "hotel_w"),
        (thrust, "thruster_w_per_n"),
        (dock, "battery", "charging_w_per_dock"),
    )
    for figure, *path in keys:
        if figure is not None:
            _put(found, max(0.0, figure.value), "apad", *map(str, path))


def _losses(found: Calibration, recordings: Sequence[ReadBag], scenario: Scenario) -> None:
    found.sound = by_range(it for recording in recordings for it in of_sound(recording.log.sounds))
    codec, period_s = codec_of(scenario), scenario.hearing.report_period_s
    found.wifi = by_range(
        it
        for recording in recordings
        for it in of_wifi(recording.facts, recording.log.track, codec, period_s)
    )
    if not found.sound:
        found.unmeasured["loss of sound"] = "musselbed/sound is not in the bags"
    if not found.wifi:
        found.unmeasured["loss of Wi-Fi"] = "no reports of floating aMussels on musselbed/heard in the bags"


def _reflown(log: VehicleLog, scenario: Scenario) -> list[Reflown]:
    mission = scenario.mission
    return refly(log, scenario.apad, mission.speed_m_s, mission.victory_radius_m)


def _residuals(flown: list[Reflown]) -> Residuals:
    pairs = [(it.real_s, off) for it in flown if (off := it.residual_s) is not None]
    offs = [off for _, off in pairs]
    return Residuals(
        len(pairs),
        mean(offs, "s"),
        sqrt(float(np.mean(np.square(offs)))) if offs else None,
        float(np.mean([real for real, _ in pairs])) if pairs else None,
    )


def yaml_lines(block: dict[str, Any], indent: int = 0) -> Iterator[str]:
    """The block as the lines of a scenario."""
    for key, value in block.items():
        if isinstance(value, dict):
            yield f"{' ' * indent}{key}:"
            yield from yaml_lines(value, indent + 2)
        else:
            yield f"{' ' * indent}{key}: {value}"
