"""A run's IMC messages: systems, places and states. Pure functions of views and the wall clock.

Field by field as the protocol's definition says (IMC 5.4): latitude and longitude in radians, a FuelLevel in percent,
oxygen in umol/l, pressure in hPa. Time stamps are Unix time by the wall clock, whatever theta is.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Iterator

from apad_bridge.events.mission_events import Phase
from apad_bridge.imc import protocol as imc
from apad_bridge.imc.picture import AMusselView, ConsoleAPad, RunPicture
from apad_bridge.imc.protocol import Message
from apad_bridge.imc.systems import NOBODY, System
from apad_bridge.records.sample_file import KeptSample
from apad_bridge.scenario.area.local_frame import LocalFrame
from firmware_model.power.charge import volts

MOST_ANNOUNCED = 50
"""A fleet of more aMussels is not announced system by system: the aPad then reports where they are."""
UMOL_L_PER_MG_L = 31.25
"""Oxygen, O2: 1000 / 32.0 g/mol."""
MISSION_PLAN = "mission"
"""The name under which the run's own mission is a plan. To start it gives the aPad back to the mission."""
ENTITIES = "System=0"
_LONGEST_TEXT = 1000
_NOT_KNOWN = -1.0
"""IMC's value for an unknown depth, altitude or progress."""
_NO_ESTIMATE = 0xFFFF
_SENSOR_CLASS = "aMussel"


def stamped(message: Message, source: System, now_s: float, to: int = NOBODY) -> Message:
    """The message with its header. ValueError for a time that is no wall clock's."""
    if not (math.isfinite(now_s) and now_s > 0):
        raise ValueError(f"no Unix time: {now_s}")
    message.timestamp = now_s
    message.src, message.src_ent = source.imc_id, 0
    message.dst, message.dst_ent = to, 255
    return message


def announce(system: System, place_rad: tuple[float, float], services: str) -> Message:
    """The message that alone puts a system on a console's map; a console ignores a place at exactly 0."""
    message = imc.Announce()
    message.sys_name, message.sys_type, message.owner = system.name, system.kind, NOBODY
    message.lat, message.lon = (it or 1e-12 for it in place_rad)
    message.services = services
    return message


def entity_list() -> Message:
    message = imc.EntityList()
    message.op, message.list = imc.EntityList.OperationEnum.REPORT, ENTITIES
    return message


def logging_started(name: str) -> Message:
    """The first message of a log: without it a review does not know whose log it is."""
    message = imc.LoggingControl()
    message.op, message.name = imc.LoggingControl.ControlOperationEnum.STARTED, name
    return message


def log_book_entry(text: str, now_s: float, *, is_warning: bool) -> Message:
    message = imc.LogBookEntry()
    kinds = imc.LogBookEntry.TypeEnum
    message.type = kinds.WARNING if is_warning else kinds.INFO
    message.htime, message.context, message.text = now_s, "musselbed", plain(text)
    return message


def plain(text: str) -> str:
    """The text in ASCII, as IMC wants it, and not too long."""
    return text.encode("ascii", "replace").decode()[:_LONGEST_TEXT]


def place_rad(frame: LocalFrame, north_m: float, east_m: float) -> tuple[float, float]:
    """Latitude and longitude in radians. ValueError for a place that is not finite or too far from the origin."""
    if not (math.isfinite(north_m) and math.isfinite(east_m)):
        raise ValueError(f"no place: {north_m}, {east_m}")
    latitude_deg, longitude_deg = frame.to_geographic(north_m, east_m)
    return math.radians(latitude_deg), math.radians(longitude_deg)


def estimated_state(frame: LocalFrame, north_m: float, east_m: float) -> Message:
    """The origin in radians, and metres from there; nothing else is known yet."""
    message = imc.EstimatedState()
    message.lat, message.lon = math.radians(frame.latitude_deg), math.radians(frame.longitude_deg)
    message.x, message.y = north_m, east_m
    message.depth = message.alt = _NOT_KNOWN
    return message


def of_apad(apad: ConsoleAPad, frame: LocalFrame) -> Iterator[Message]:
    """The aPad's place and battery."""
    state = estimated_state(frame, apad.north_m, apad.east_m)
    state.psi = math.remainder(apad.heading_rad, math.tau)
    state.vx, state.vy = apad.velocity_m_s
    state.u = state.vx * math.cos(state.psi) + state.vy * math.sin(state.psi)
    state.v = state.vy * math.cos(state.psi) - state.vx * math.sin(state.psi)
    state.depth = 0.0
    yield state
    if apad.fraction is not None:
        yield fuel(apad.fraction, 1.0)
    if apad.voltage_v is not None:
        yield voltage(apad.voltage_v)


def of_amussel(amussel: AMusselView, frame: LocalFrame) -> Iterator[Message]:
    """The believed place, charge and state of an aMussel."""
    state = estimated_state(frame, amussel.north_m, amussel.east_m)
    if amussel.is_up:
        state.depth = 0.0
    yield state
    yield fuel(amussel.fraction, 0.0 if amussel.spread is None else 1.0 - amussel.spread)
    yield voltage(volts(amussel.fraction))
    yield entity_state(amussel)


def fuel(fraction: float, confidence: float) -> Message:
    """Both in percent, from parts of 1."""
    message = imc.FuelLevel()
    message.value = 100 * min(1.0, max(0.0, fraction))
    message.confidence = 100 * min(1.0, max(0.0, confidence))
    return message


def voltage(value_v: float) -> Message:
    message = imc.Voltage()
    message.value = value_v
    return message


def entity_state(amussel: AMusselView) -> Message:
    states = imc.EntityState.StateEnum
    message = imc.EntityState()
    message.state = states.NORMAL
    if amussel.is_lost:
        message.state = states.FAILURE
    elif amussel.is_stranded:
        message.state = states.FAULT
    message.description = amussel.state.name.lower().replace("_", " ")
    return message


def reported(name: str, amussel: AMusselView, frame: LocalFrame) -> Iterator[Message]:
    """An aMussel of a large fleet, in messages of the aPad's: an external system on the map, with a line of text."""
    latitude_longitude = place_rad(frame, amussel.north_m, amussel.east_m)
    seen = imc.ReportedState()
    seen.lat, seen.lon = latitude_longitude
    seen.sid, seen.s_type = name, imc.ReportedState.SourceTypeEnum.ACOUSTIC_MODEM
    yield seen
    sensor = imc.RemoteSensorInfo()
    sensor.id, sensor.sensor_class = name, _SENSOR_CLASS
    sensor.lat, sensor.lon = latitude_longitude
    sensor.data = f"state={amussel.state.name.lower()};fuel={100 * amussel.fraction:.0f}"
    yield sensor


def of_sample(sample: KeptSample) -> Iterator[Message]:
    """The readings of a sample, in IMC's units; readings outside their sensor's range are left out."""
    saturated = set(sample.columns.get("saturated", ()))
    for name, key, kind, per_unit in _READINGS:
        value = sample.columns.get(key)
        if name in saturated or not isinstance(value, int | float) or not math.isfinite(value):
            continue
        message = kind()
        message.value = value * per_unit
        yield message


_READINGS = (
    ("oxygen", "oxygen_mg_l", imc.DissolvedOxygen, UMOL_L_PER_MG_L),
    ("turbidity", "turbidity_ntu", imc.Turbidity, 1.0),
    ("temperature", "temperature_c", imc.Temperature, 1.0),
    ("pressure", "pressure_mbar", imc.Pressure, 1.0),  # hPa
)
"""The sensor, its key, IMC's message, and the factor to its unit."""


def plan_control_state(picture: RunPicture, plan_id: str, *, takes_orders: bool) -> Message:
    """The plan that the aPad executes: the mission, or a person's manoeuvre with the plan `plan_id`."""
    states, outcomes = (
        imc.PlanControlState.StateEnum,
        imc.PlanControlState.LastPlanOutcomeEnum,
    )
    message = imc.PlanControlState()
    message.plan_eta = message.man_eta = -1
    message.plan_progress = _NOT_KNOWN
    message.last_outcome = outcomes.NONE
    if picture.last_failed is not None:
        message.last_outcome = outcomes.FAILURE if picture.last_failed else outcomes.SUCCESS
    if not takes_orders or picture.ended_by is not None:
        message.state = states.BLOCKED
    elif picture.is_by_hand and picture.manoeuvre is None:
        message.state = states.READY
    else:
        message.state = states.EXECUTING
        message.plan_id = plain(plan_id if picture.is_by_hand else MISSION_PLAN)
        message.man_id, message.man_type = plain(picture.primitive), _manoeuvre_type(picture)
        if picture.progress is not None:
            message.plan_progress = 100 * picture.progress
    return message


def vehicle_state(picture: RunPicture, *, takes_orders: bool) -> Message:
    """The aPad's state: ready for a plan, or executing one."""
    modes = imc.VehicleState.OperationModeEnum
    message = imc.VehicleState()
    message.op_mode, message.maneuver_type = modes.SERVICE, _manoeuvre_type(picture)
    message.maneuver_eta = _NO_ESTIMATE
    if not takes_orders and picture.ended_by is None:
        message.op_mode = modes.ERROR
        message.error_count, message.last_error = 1, "no supervisor takes orders"
        message.error_ents = "System"
    elif message.maneuver_type != _NO_ESTIMATE and picture.phase != Phase.ENDED.value:
        message.op_mode = modes.MANEUVER
    return message


def _manoeuvre_type(picture: RunPicture) -> int:
    if picture.primitive.startswith("go to point"):
        return int(imc.Goto().msg_id)
    return int(imc.StationKeeping().msg_id) if picture.primitive.startswith("hold position") else _NO_ESTIMATE


def plan_information(plan: Message, changed_s: float, by: int) -> Message:
    """An entry of the list of plans."""
    content = plan.serialize_fields()
    message = imc.PlanDBInformation()
    message.plan_id, message.plan_size = plan.plan_id, len(content)
    message.change_time, message.change_sid = changed_s, by
    message.md5 = hashlib.md5(content, usedforsecurity=False).digest()
    return message


def plan_list(entries: Iterable[Message], name: str) -> Message:
    """The state of the store of plans."""
    message = imc.PlanDBState()
    listed = list(entries)
    message.plan_count, message.plan_size = len(listed), sum(it.plan_size for it in listed)
    if (newest := max(listed, key=lambda it: float(it.change_time), default=None)) is not None:
        message.change_time, message.change_sid = newest.change_time, newest.change_sid
    message.change_sname = name
    digest = hashlib.md5(b"".join(it.md5 for it in listed), usedforsecurity=False)
    message.md5 = digest.digest()
    message.plans_info.extend(listed)
    return message
