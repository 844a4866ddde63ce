"""An IMC codec that shares nothing with imcpy: pyimclsts, over the definitions below.

The definitions are those of IMC 5.4, written down again from the protocol's description: id, name, and fields in order.
pyimclsts turns them into classes, refuses what is outside a field's range, and packs big-endian.
"""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

DEFINITIONS = """
1 EntityState state:u8 flags:u8 description:text
3 EntityInfo id:u8 label:text component:text act_time:u16 deact_time:u16
5 EntityList op:u8 list:text
102 LoggingControl op:u8 name:text
103 LogBookEntry type:u8 htime:f64 context:text text:text
150 Heartbeat
151 Announce sys_name:text sys_type:u8 owner:u16 lat:f64:1.5707964 lon:f64:3.1415927 height:f32 services:text
251 Voltage value:f32
263 Temperature value:f32
264 Pressure value:f64
279 FuelLevel value:f32:100 confidence:f32:100 opmodes:text
288 Turbidity value:f32
295 DissolvedOxygen value:f32
350 EstimatedState lat:f64:1.5707964 lon:f64:3.1415927 height:f32 x:f32 y:f32 z:f32 phi:f32:3.1415927 \
theta:f32:1.5707964 psi:f32:3.1415928 u:f32 v:f32 w:f32 vx:f32 vy:f32 vz:f32 p:f32 q:f32 r:f32 depth:f32 alt:f32
450 Goto timeout:u16 lat:f64:1.5707964 lon:f64:3.1415927 z:f32 z_units:u8 speed:f32 speed_units:u8 \
roll:f64 pitch:f64 yaw:f64 custom:text
461 StationKeeping lat:f64:1.5707964 lon:f64:3.1415927 z:f32 z_units:u8 radius:f32 duration:u16 speed:f32 \
speed_units:u8 custom:text
500 VehicleState op_mode:u8 error_count:u8 error_ents:text maneuver_type:u16 maneuver_stime:f64 maneuver_eta:u16 \
control_loops:u32 flags:u8 last_error:text last_error_time:f64
550 Abort
551 PlanSpecification plan_id:text description:text vnamespace:text variables:list start_man_id:text maneuvers:list \
transitions:list start_actions:list end_actions:list
552 PlanManeuver maneuver_id:text data:message start_actions:list end_actions:list
556 PlanDB type:u8 op:u8 request_id:u16 plan_id:text arg:message info:text
557 PlanDBState plan_count:u16 plan_size:u32 change_time:f64 change_sid:u16 change_sname:text md5:raw plans_info:list
558 PlanDBInformation plan_id:text plan_size:u16 change_time:f64 change_sid:u16 change_sname:text md5:raw
559 PlanControl type:u8 op:u8 request_id:u16 plan_id:text flags:u16 arg:message info:text
560 PlanControlState state:u8 plan_id:text plan_eta:i32 plan_progress:f32 man_id:text man_type:u16 man_eta:i32 \
last_outcome:u8
600 ReportedState lat:f64:1.5707964 lon:f64:3.1415927 depth:f64 roll:f64 pitch:f64 yaw:f64 rcp_time:f64 sid:text s_type:u8
601 RemoteSensorInfo id:text sensor_class:text lat:f64:1.5707964 lon:f64:3.1415927 alt:f32 heading:f32 data:text
"""
_TYPES = {
    "u8": "uint8_t",
    "u16": "uint16_t",
    "u32": "uint32_t",
    "i32": "int32_t",
    "f32": "fp32_t",
    "f64": "fp64_t",
    "text": "plaintext",
    "raw": "rawdata",
    "message": "message",
    "list": "message-list",
}
_BLANK = {"plaintext": "", "rawdata": b"", "message-list": (), "message": None}
_HEADER = """<messages name="IMC"><types><description>d</description>{types}</types>
<enumerations><def name="B" abbrev="Boolean" prefix="B"><value id="0" name="F" abbrev="FALSE"/></def>
<def name="C" abbrev="Other" prefix="C"><value id="0" name="F" abbrev="NONE"/></def></enumerations>
<bitfields><def name="M" abbrev="Mask" prefix="M"><value id="1" name="P" abbrev="PATH"/></def>
<def name="N" abbrev="Other" prefix="N"><value id="1" name="P" abbrev="PATH"/></def></bitfields>
<categories><category name="Core"/><category name="Other"/></categories>
<header><description>d</description><field name="s" abbrev="sync" type="uint16_t" value="0xFE54"/>
<field name="m" abbrev="mgid" type="uint16_t"/></header>
"""


def _xml() -> str:
    types = "".join(
        f'<type name="{name}"><description>{"float" if name[0] == "f" else "integer"}</description></type>'
        for name in (
            "int8_t",
            "uint8_t",
            "int16_t",
            "uint16_t",
            "int32_t",
            "uint32_t",
            "int64_t",
            "fp32_t",
            "fp64_t",
        )
    )
    types += "".join(
        f'<type name="{name}"><description>other</description></type>'
        for name in ("rawdata", "plaintext", "message", "message-list")
    )
    return (
        _HEADER.format(types=types) + "".join(map(_message, DEFINITIONS.strip().splitlines())) + "</messages>"
    )


def _message(line: str) -> str:
    number, name, *fields = line.split()
    text = (
        f'<message id="{number}" name="{name}" abbrev="{name}" category="Core"><description>d</description>'
    )
    for field in fields:
        key, kind, *limit = field.split(":")
        low = "" if not limit else f' min="{"0" if limit == ["100"] else f"-{limit[0]}"}" max="{limit[0]}"'
        text += f'<field name="{key}" abbrev="{key}" type="{_TYPES[kind]}"{low}><description>d</description></field>'
    return text + "</message>"


class Codec:
    """Reads and writes packets. One for a process: pyimclsts loads its classes once, from the working directory."""

    def __init__(self, folder: Path) -> None:
        (folder / "IMC.xml").write_text(_xml())
        subprocess.run(
            [sys.executable, "-m", "pyimclsts.extract"],
            cwd=folder,
            check=True,
            capture_output=True,
            timeout=300,
        )
        before = os.getcwd()
        os.chdir(folder)
        try:
            self._network = import_module("pyimclsts.network")
        finally:
            os.chdir(before)
        self._core = import_module("pyimclsts.core")
        self._classes = sys.modules["pyimc_generated"].messages

    def make(self, name: str, **values: Any) -> Any:
        """A message with these fields; the others are 0 or empty."""
        message = getattr(self._classes, name)()
        for field in message.Attributes.fields:
            kind = getattr(type(message), field)._field_def["type"]
            value = values.pop(field, _BLANK.get(kind, 0))
            if value is not None:
                setattr(message, field, list(value) if kind == "message-list" else value)
        assert not values, f"{name} has no {values}"
        return message

    def pack(self, message: Any, src: int, dst: int) -> bytes:
        data: bytes = message.pack(is_big_endian=True, src=src, src_ent=0, dst=dst, dst_ent=255)
        return data

    def read(self, packet: bytes) -> Any:
        """The message of one whole packet, whose check sum must be right."""
        assert self._core.CRC16IMB(packet[:-2]) == int.from_bytes(packet[-2:], "little")
        assert int.from_bytes(packet[4:6], "little") == len(packet) - 22
        message = self._network.unpack(packet, is_big_endian=False)
        assert name_of(message) != "Unknown"
        return message

    def read_log(self, data: bytes) -> list[Any]:
        """All whole messages of an LSF log, which may still be written."""
        messages, start = [], 0
        while start < len(data):
            end = start + 22 + int.from_bytes(data[start + 4 : start + 6], "little")
            if end > len(data):
                break
            messages.append(self.read(data[start:end]))
            start = end
        return messages


def name_of(message: Any) -> str:
    return str(message.Attributes.abbrev)


def header_of(message: Any) -> Any:
    return message._header


def inner(message: Any, field: str) -> Any:
    """A field that is a message or a list of them; pyimclsts's own road copies these, and fails."""
    return getattr(message, f"_{field}")
