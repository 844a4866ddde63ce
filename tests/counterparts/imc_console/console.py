"""An operator's console for IMC, as an independent counterpart for tests.

The module has two parts. The codec packs and parses IMC messages. The console
is a process: it speaks IMC on UDP on loopback, reads commands from standard
input and prints JSON lines on standard output. README.md gives the forms.

The module uses the standard library only. All sockets bind to 127.0.0.1.
"""

import argparse
import contextlib
import dataclasses
import heapq
import ipaddress
import itertools
import json
import math
import os
import queue
import random
import re
import selectors
import shlex
import socket
import struct
import sys
import threading
import time

# --------------------------------------------------------------------------
# Codec: tables
# --------------------------------------------------------------------------

SYNC = 0xFE54
HEADER_SIZE = 20
FOOTER_SIZE = 2
NULL_ID = 0xFFFF
HEADER = "HHHdHBHB"
MAX_DEPTH = 16

# Each entry: name -> (id, [(field, type), ...]).
# Types: u8 u16 u32 i16 i32 f32 f64, text (UTF-8), raw (octets),
# msg (inline message or None), list (inline messages).
MESSAGES = {
    # Named by the text.
    "EntityState": (1, [("state", "u8"), ("flags", "u8"), ("description", "text")]),
    "EntityList": (5, [("op", "u8"), ("list", "text")]),
    "LogBookEntry": (103, [("type", "u8"), ("htime", "f64"), ("context", "text"), ("text", "text")]),
    "Heartbeat": (150, []),
    "Announce": (
        151,
        [
            ("sys_name", "text"),
            ("sys_type", "u8"),
            ("owner", "u16"),
            ("lat", "f64"),
            ("lon", "f64"),
            ("height", "f32"),
            ("services", "text"),
        ],
    ),
    "Voltage": (251, [("value", "f32")]),
    "Temperature": (263, [("value", "f32")]),
    "Pressure": (264, [("value", "f64")]),
    "FuelLevel": (279, [("value", "f32"), ("confidence", "f32"), ("opmodes", "text")]),
    "Turbidity": (288, [("value", "f32")]),
    "DissolvedOxygen": (295, [("value", "f32")]),
    "EstimatedState": (
        350,
        [
            ("lat", "f64"),
            ("lon", "f64"),
            ("height", "f32"),
            ("x", "f32"),
            ("y", "f32"),
            ("z", "f32"),
            ("phi", "f32"),
            ("theta", "f32"),
            ("psi", "f32"),
            ("u", "f32"),
            ("v", "f32"),
            ("w", "f32"),
            ("vx", "f32"),
            ("vy", "f32"),
            ("vz", "f32"),
            ("p", "f32"),
            ("q", "f32"),
            ("r", "f32"),
            ("depth", "f32"),
            ("alt", "f32"),
        ],
    ),
    "Goto": (
        450,
        [
            ("timeout", "u16"),
            ("lat", "f64"),
            ("lon", "f64"),
            ("z", "f32"),
            ("z_units", "u8"),
            ("speed", "f32"),
            ("speed_units", "u8"),
            ("roll", "f64"),
            ("pitch", "f64"),
            ("yaw", "f64"),
            ("custom", "text"),
        ],
    ),
    "StationKeeping": (
        461,
        [
            ("lat", "f64"),
            ("lon", "f64"),
            ("z", "f32"),
            ("z_units", "u8"),
            ("radius", "f32"),
            ("duration", "u16"),
            ("speed", "f32"),
            ("speed_units", "u8"),
            ("custom", "text"),
        ],
    ),
    "VehicleState": (
        500,
        [
            ("op_mode", "u8"),
            ("error_count", "u8"),
            ("error_ents", "text"),
            ("maneuver_type", "u16"),
            ("maneuver_stime", "f64"),
            ("maneuver_eta", "u16"),
            ("control_loops", "u32"),
            ("flags", "u8"),
            ("last_error", "text"),
            ("last_error_time", "f64"),
        ],
    ),
    "Abort": (550, []),
    "PlanDB": (
        556,
        [
            ("type", "u8"),
            ("op", "u8"),
            ("request_id", "u16"),
            ("plan_id", "text"),
            ("arg", "msg"),
            ("info", "text"),
        ],
    ),
    "PlanControl": (
        559,
        [
            ("type", "u8"),
            ("op", "u8"),
            ("request_id", "u16"),
            ("plan_id", "text"),
            ("flags", "u16"),
            ("arg", "msg"),
            ("info", "text"),
        ],
    ),
    "PlanControlState": (
        560,
        [
            ("state", "u8"),
            ("plan_id", "text"),
            ("plan_eta", "i32"),
            ("plan_progress", "f32"),
            ("man_id", "text"),
            ("man_type", "u16"),
            ("man_eta", "i32"),
            ("last_outcome", "u8"),
        ],
    ),
    "ReportedState": (
        600,
        [
            ("lat", "f64"),
            ("lon", "f64"),
            ("depth", "f64"),
            ("roll", "f64"),
            ("pitch", "f64"),
            ("yaw", "f64"),
            ("rcp_time", "f64"),
            ("sid", "text"),
            ("s_type", "u8"),
        ],
    ),
    "RemoteSensorInfo": (
        601,
        [
            ("id", "text"),
            ("sensor_class", "text"),
            ("lat", "f64"),
            ("lon", "f64"),
            ("alt", "f32"),
            ("heading", "f32"),
            ("data", "text"),
        ],
    ),
    # Needed as arguments of the above.
    "PlanSpecification": (
        551,
        [
            ("plan_id", "text"),
            ("description", "text"),
            ("vnamespace", "text"),
            ("variables", "list"),
            ("start_man_id", "text"),
            ("maneuvers", "list"),
            ("transitions", "list"),
            ("start_actions", "list"),
            ("end_actions", "list"),
        ],
    ),
    "PlanManeuver": (
        552,
        [("maneuver_id", "text"), ("data", "msg"), ("start_actions", "list"), ("end_actions", "list")],
    ),
    "PlanTransition": (
        553,
        [("source_man", "text"), ("dest_man", "text"), ("conditions", "text"), ("actions", "list")],
    ),
    "PlanDBState": (
        557,
        [
            ("plan_count", "u16"),
            ("plan_size", "u32"),
            ("change_time", "f64"),
            ("change_sid", "u16"),
            ("change_sname", "text"),
            ("md5", "raw"),
            ("plans_info", "list"),
        ],
    ),
    "PlanDBInformation": (
        558,
        [
            ("plan_id", "text"),
            ("plan_size", "u16"),
            ("change_time", "f64"),
            ("change_sid", "u16"),
            ("change_sname", "text"),
            ("md5", "raw"),
        ],
    ),
    "PlanVariable": (561, [("name", "text"), ("value", "text"), ("type", "u8"), ("access", "u8")]),
    # From general knowledge; the text does not name them (see OPEN.md).
    "QueryEntityState": (2, []),
    "EntityInfo": (
        3,
        [("id", "u8"), ("label", "text"), ("component", "text"), ("act_time", "u16"), ("deact_time", "u16")],
    ),
    "QueryEntityInfo": (4, [("id", "u8")]),
    "CpuUsage": (7, [("value", "u8")]),
    "StorageUsage": (100, [("available", "u32"), ("value", "u8")]),
    "LogBookControl": (104, [("command", "u8"), ("htime", "f64"), ("msg", "list")]),
    "Rpm": (250, [("value", "i16")]),
    "Current": (252, [("value", "f32")]),
    "GpsFix": (
        253,
        [
            ("validity", "u16"),
            ("type", "u8"),
            ("utc_year", "u16"),
            ("utc_month", "u8"),
            ("utc_day", "u8"),
            ("utc_time", "f32"),
            ("lat", "f64"),
            ("lon", "f64"),
            ("height", "f32"),
            ("satellites", "u8"),
            ("cog", "f32"),
            ("sog", "f32"),
            ("hdop", "f32"),
            ("vdop", "f32"),
            ("hacc", "f32"),
            ("vacc", "f32"),
        ],
    ),
    "SoundSpeed": (267, [("value", "f32")]),
    "Conductivity": (269, [("value", "f32")]),
    "Salinity": (270, [("value", "f32")]),
    "RemoteActionsRequest": (304, [("op", "u8"), ("actions", "text")]),
    "RemoteActions": (305, [("actions", "text")]),
    "Teleoperation": (452, [("custom", "text")]),
    "Loiter": (
        453,
        [
            ("timeout", "u16"),
            ("lat", "f64"),
            ("lon", "f64"),
            ("z", "f32"),
            ("z_units", "u8"),
            ("duration", "u16"),
            ("speed", "f32"),
            ("speed_units", "u8"),
            ("type", "u8"),
            ("radius", "f32"),
            ("length", "f32"),
            ("bearing", "f64"),
            ("direction", "u8"),
            ("custom", "text"),
        ],
    ),
    "IdleManeuver": (454, [("duration", "u16"), ("custom", "text")]),
    "TeleoperationDone": (460, []),
    "VehicleCommand": (
        501,
        [
            ("type", "u8"),
            ("request_id", "u16"),
            ("command", "u8"),
            ("maneuver", "msg"),
            ("calib_time", "u16"),
            ("info", "text"),
        ],
    ),
    "EntityParameter": (801, [("name", "text"), ("value", "text")]),
    "EntityParameters": (802, [("name", "text"), ("params", "list")]),
    "QueryEntityParameters": (803, [("name", "text"), ("visibility", "text"), ("scope", "text")]),
    "SetEntityParameters": (804, [("name", "text"), ("params", "list")]),
}
BY_ID = {number: name for name, (number, _) in MESSAGES.items()}

ENUMS = {
    ("Announce", "sys_type"): [
        "CCU",
        "HUMANSENSOR",
        "UUV",
        "USV",
        "UAV",
        "UGV",
        "STATICSENSOR",
        "MOBILESENSOR",
        "WSN",
    ],
    ("EntityState", "state"): ["BOOT", "NORMAL", "FAULT", "ERROR", "FAILURE"],
    ("EntityList", "op"): ["REPORT", "QUERY"],
    ("LogBookEntry", "type"): ["INFO", "WARNING", "ERROR", "CRITICAL", "DEBUG"],
    ("LogBookControl", "command"): ["GET", "CLEAR", "GET_ERR", "REPLY"],
    ("Goto", "z_units"): ["NONE", "DEPTH", "ALTITUDE", "HEIGHT"],
    ("Goto", "speed_units"): ["METERS_PS", "RPM", "PERCENTAGE"],
    ("StationKeeping", "z_units"): ["NONE", "DEPTH", "ALTITUDE", "HEIGHT"],
    ("StationKeeping", "speed_units"): ["METERS_PS", "RPM", "PERCENTAGE"],
    ("Loiter", "z_units"): ["NONE", "DEPTH", "ALTITUDE", "HEIGHT"],
    ("Loiter", "speed_units"): ["METERS_PS", "RPM", "PERCENTAGE"],
    ("VehicleState", "op_mode"): ["SERVICE", "CALIBRATION", "ERROR", "MANEUVER", "EXTERNAL", "BOOT"],
    ("VehicleCommand", "type"): ["REQUEST", "SUCCESS", "IN_PROGRESS", "FAILURE"],
    ("VehicleCommand", "command"): [
        "EXEC_MANEUVER",
        "STOP_MANEUVER",
        "START_CALIBRATION",
        "STOP_CALIBRATION",
    ],
    ("PlanDB", "type"): ["REQUEST", "SUCCESS", "FAILURE", "IN_PROGRESS"],
    ("PlanDB", "op"): ["SET", "DEL", "GET", "GET_INFO", "CLEAR", "GET_STATE", "GET_DSTATE", "BOOT"],
    ("PlanControl", "type"): ["REQUEST", "SUCCESS", "FAILURE", "IN_PROGRESS"],
    ("PlanControl", "op"): ["START", "STOP", "LOAD", "GET"],
    ("PlanControlState", "state"): ["BLOCKED", "READY", "INITIALIZING", "EXECUTING"],
    ("PlanControlState", "last_outcome"): ["NONE", "SUCCESS", "FAILURE"],
    ("RemoteActionsRequest", "op"): ["REPORT", "QUERY"],
}

FORMATS = {"u8": "B", "u16": "H", "u32": "I", "i16": "h", "i32": "i", "f32": "f", "f64": "d"}


class ImcError(ValueError):
    """A datagram that is no good IMC message.

    reason is one of "short", "bad sync", "bad CRC", "unknown id" and
    "bad payload". header is a dict of header values, if the header and the
    CRC were good, else None.
    """

    def __init__(self, reason, detail="", header=None):
        super().__init__(f"{reason}: {detail}" if detail else reason)
        self.reason = reason
        self.detail = detail
        self.header = header


@dataclasses.dataclass
class Message:
    """One parsed IMC message.

    timestamp is in seconds since 1970 (UTC). order is "big" or "little".
    length is the number of octets of the whole message. fields holds the
    values in the units of IMC (lat and lon in radians).
    """

    name: str
    fields: dict
    id: int = 0
    timestamp: float = 0.0
    src: int = NULL_ID
    src_ent: int = 255
    dst: int = NULL_ID
    dst_ent: int = 255
    order: str = "big"
    length: int = 0


def enum_name(message, field, value):
    """Return the name of an enumerated value, or the number as text.

    There is no unit and no error.
    """
    names = ENUMS.get((message, field), [])
    return names[value] if 0 <= value < len(names) else str(value)


def enum_value(message, field, name):
    """Return the number of an enumerated name.

    Raises ValueError if the field has no such name.
    """
    names = ENUMS.get((message, field), [])
    if name not in names:
        raise ValueError(f"{message}.{field} has no value {name!r}")
    return names.index(name)


# --------------------------------------------------------------------------
# Codec: CRC, pack, parse
# --------------------------------------------------------------------------


def _crc_table():
    table = []
    for value in range(256):
        for _ in range(8):
            value = (value >> 1) ^ 0xA001 if value & 1 else value >> 1
        table.append(value)
    return table


CRC_TABLE = _crc_table()


def crc16(data, crc=0):
    """Return the CRC-16-IBM of data (octets), as an integer of 16 bits.

    The polynomial is 0x8005, reflected. The start value is 0. There is no
    error.
    """
    for octet in data:
        crc = (crc >> 8) ^ CRC_TABLE[(crc ^ octet) & 0xFF]
    return crc


def _endian(order):
    if order == "big":
        return ">"
    if order == "little":
        return "<"
    raise ValueError(f"order must be 'big' or 'little', not {order!r}")


def pack_fields(name, fields, order="big"):
    """Return the payload (octets) of a message.

    fields maps field names to values in IMC units. A missing field gets 0,
    an empty text, no message or an empty list. An enumerated field also takes
    its name. An inline message is a pair (name, fields). Raises ValueError
    for an unknown message, an unknown field or a value out of range.
    """
    if name not in MESSAGES:
        raise ValueError(f"unknown message {name!r}")
    _, layout = MESSAGES[name]
    extra = set(fields) - {field for field, _ in layout}
    if extra:
        raise ValueError(f"{name} has no field {sorted(extra)[0]!r}")
    end = _endian(order)
    out = bytearray()
    for field, kind in layout:
        value = fields.get(field)
        where = f"{name}.{field}"
        if kind in FORMATS:
            if value is None:
                value = 0
            if isinstance(value, str):
                value = enum_value(name, field, value)
            try:
                out += struct.pack(end + FORMATS[kind], value)
            except (struct.error, OverflowError, TypeError) as error:
                raise ValueError(f"{where}: {value!r} does not fit {kind} ({error})") from None
        elif kind in ("text", "raw"):
            if value is None:
                value = b""
            if isinstance(value, str):
                value = value.encode("utf-8") if kind == "text" else bytes.fromhex(value)
            if not isinstance(value, (bytes, bytearray)):
                raise ValueError(f"{where}: {value!r} is no text")
            if len(value) > 0xFFFF:
                raise ValueError(f"{where}: {len(value)} octets are too many")
            out += struct.pack(end + "H", len(value)) + value
        elif kind == "msg":
            out += _pack_inline(value, order, where)
        else:
            value = [] if value is None else list(value)
            if len(value) > 0xFFFF:
                raise ValueError(f"{where}: {len(value)} messages are too many")
            out += struct.pack(end + "H", len(value))
            for item in value:
                out += _pack_inline(item, order, where)
    return bytes(out)


def _pack_inline(value, order, where):
    if value is None:
        return struct.pack(_endian(order) + "H", NULL_ID)
    try:
        name, fields = value
    except (TypeError, ValueError):
        raise ValueError(f"{where}: {value!r} is no pair (name, fields)") from None
    payload = pack_fields(name, fields, order)
    return struct.pack(_endian(order) + "H", MESSAGES[name][0]) + payload


def encode(
    name, fields=None, *, src=NULL_ID, dst=NULL_ID, src_ent=255, dst_ent=255, timestamp=None, order="big"
):
    """Return one whole IMC message (octets): header, payload and CRC.

    timestamp is in seconds since 1970; None takes the clock. order is "big"
    or "little". Raises ValueError for a value out of range.
    """
    payload = pack_fields(name, fields or {}, order)
    if timestamp is None:
        timestamp = time.time()
    end = _endian(order)
    try:
        head = struct.pack(
            end + HEADER, SYNC, MESSAGES[name][0], len(payload), timestamp, src, src_ent, dst, dst_ent
        )
    except struct.error as error:
        raise ValueError(f"header of {name}: {error}") from None
    body = head + payload
    return body + struct.pack(end + "H", crc16(body))


class _Reader:
    """Reads values from a payload. It raises ImcError if the payload ends."""

    def __init__(self, data, order):
        self.data, self.end, self.pos, self.depth = data, _endian(order), 0, 0

    def take(self, count, where):
        if self.pos + count > len(self.data):
            raise ImcError("bad payload", f"{where} ends after the payload")
        chunk = self.data[self.pos : self.pos + count]
        self.pos += count
        return chunk

    def number(self, code, where):
        code = self.end + code
        return struct.unpack(code, self.take(struct.calcsize(code), where))[0]

    def inline(self, where):
        number = self.number("H", where)
        if number == NULL_ID:
            return None
        if number not in BY_ID:
            raise ImcError("unknown id", f"{where} holds the inline id {number}")
        name = BY_ID[number]
        if self.depth >= MAX_DEPTH:
            raise ImcError("bad payload", f"{where} is deeper than {MAX_DEPTH} messages")
        self.depth += 1
        value = (name, self.fields(name))
        self.depth -= 1
        return value

    def fields(self, name):
        out = {}
        for field, kind in MESSAGES[name][1]:
            where = f"{name}.{field}"
            if kind in FORMATS:
                out[field] = self.number(FORMATS[kind], where)
            elif kind == "text":
                octets = self.take(self.number("H", where), where)
                try:
                    out[field] = octets.decode("utf-8")
                except UnicodeDecodeError:
                    raise ImcError("bad payload", f"{where} is no UTF-8") from None
            elif kind == "raw":
                out[field] = self.take(self.number("H", where), where)
            elif kind == "msg":
                out[field] = self.inline(where)
            else:
                out[field] = [self.inline(where) for _ in range(self.number("H", where))]
        return out


def decode(data):
    """Parse the first IMC message in data (octets) and return a Message.

    It takes both byte orders and tells them by the sync number. Message.length
    tells how many octets it used. Raises ImcError with the reason.
    """
    if len(data) < 2:
        raise ImcError("short", f"{len(data)} octets")
    if data[:2] == b"\xfe\x54":
        order = "big"
    elif data[:2] == b"\x54\xfe":
        order = "little"
    else:
        raise ImcError("bad sync", data[:2].hex())
    if len(data) < HEADER_SIZE + FOOTER_SIZE:
        raise ImcError("short", f"{len(data)} octets, a message has at least 22")
    end = _endian(order)
    _, number, size, timestamp, src, src_ent, dst, dst_ent = struct.unpack(end + HEADER, data[:HEADER_SIZE])
    length = HEADER_SIZE + size + FOOTER_SIZE
    if len(data) < length:
        raise ImcError("short", f"{len(data)} octets, the header says {length}")
    body = data[: HEADER_SIZE + size]
    want = crc16(body)
    got = struct.unpack(end + "H", data[length - 2 : length])[0]
    if want != got:
        raise ImcError("bad CRC", f"0x{got:04x} came, 0x{want:04x} is right")
    header = {
        "id": number,
        "src": src,
        "src_ent": src_ent,
        "dst": dst,
        "dst_ent": dst_ent,
        "timestamp": timestamp,
        "order": order,
        "length": length,
    }
    if number not in BY_ID:
        raise ImcError("unknown id", f"id {number}", header)
    name = BY_ID[number]
    reader = _Reader(body[HEADER_SIZE:], order)
    try:
        fields = reader.fields(name)
    except ImcError as error:
        error.header = header
        raise
    if reader.pos != size:
        raise ImcError("bad payload", f"{name} has {size - reader.pos} octets too many", header)
    return Message(name=name, fields=fields, **header)


# --------------------------------------------------------------------------
# Small helpers
# --------------------------------------------------------------------------


def displace(lat, lon, north, east):
    """Return (lat, lon) moved by north and east.

    lat and lon are in radians, north and east in metres. It uses the radii of
    the WGS84 ellipsoid at lat; it is good for some kilometres. Near the poles
    the longitude stays. There is no error.
    """
    a, e2 = 6378137.0, 0.00669437999014
    root = 1.0 - e2 * math.sin(lat) ** 2
    meridian = a * (1.0 - e2) / root**1.5
    normal = a / math.sqrt(root)
    cosine = math.cos(lat)
    lat_out = lat + north / meridian
    lon_out = lon + (east / (normal * cosine) if abs(cosine) > 1e-9 else 0.0)
    return lat_out, lon_out


def parse_services(text, scheme="imc+udp"):
    """Return the list of (host, port) that an Announce names for a scheme.

    text is the field services, with ";" between the URLs. It leaves out what
    it cannot read. There is no error.
    """
    out = []
    for url in text.split(";"):
        match = re.fullmatch(re.escape(scheme) + r"://([^/:\s]+):(\d+)(/.*)?", url.strip())
        if match and 0 < int(match.group(2)) < 65536:
            out.append((match.group(1), int(match.group(2))))
    return out


def loopback(host):
    """Tell if host (text) is a numeric loopback address or "localhost".

    There is no error.
    """
    if host == "localhost":
        return True
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return False
    return address.version == 4 and address.is_loopback


def choose_address(services, source):
    """Choose the UDP address of a system.

    services is the text of the Announce, source the (host, port) that the
    Announce came from. It takes the source if the services name it, else a
    service with the host of the source, else the first service on loopback.
    It returns None if no service is on loopback. There is no error.
    """
    named = [
        ("127.0.0.1" if host == "localhost" else host, port)
        for host, port in parse_services(services)
        if loopback(host)
    ]
    if tuple(source) in named:
        return tuple(source)
    for host, port in named:
        if host == source[0]:
            return host, port
    return named[0] if named else None


def plain(value):
    """Return value in a form that strict JSON can hold.

    Octets become hex text, inline messages become objects, NaN and infinity
    become text. There is no error.
    """
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, (bytes, bytearray)):
        return bytes(value).hex()
    if (
        isinstance(value, tuple)
        and len(value) == 2
        and isinstance(value[0], str)
        and isinstance(value[1], dict)
    ):
        return {"message": value[0], "fields": plain(value[1])}
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return value


def unplain(fields):
    """Return fields from JSON in the form that encode takes.

    It is the inverse of plain for inline messages. Raises ValueError if an
    inline message has no text "message".
    """

    def one(value):
        if isinstance(value, dict):
            if not isinstance(value.get("message"), str):
                raise ValueError("an inline message needs a text 'message'")
            return value["message"], unplain(value.get("fields") or {})
        if isinstance(value, list):
            return [one(item) for item in value]
        if value in ("nan", "inf", "-inf"):
            return float(value)
        return value

    if not isinstance(fields, dict):
        raise ValueError("the fields must be a JSON object")
    return {key: one(value) for key, value in fields.items()}


def make_plan(plan_id, maneuvers):
    """Return a PlanSpecification as a pair (name, fields).

    maneuvers is a list of inline messages. They run in turn; a transition
    leads from each to the next. Raises ValueError if the list is empty.
    """
    if not maneuvers:
        raise ValueError("a plan needs a maneuver")
    ids = [f"{maneuver[0]}{index}" for index, maneuver in enumerate(maneuvers, 1)]
    return "PlanSpecification", {
        "plan_id": plan_id,
        "start_man_id": ids[0],
        "maneuvers": [
            ("PlanManeuver", {"maneuver_id": key, "data": maneuver})
            for key, maneuver in zip(ids, maneuvers, strict=False)
        ],
        "transitions": [
            ("PlanTransition", {"source_man": first, "dest_man": second, "conditions": "ManeuverIsDone"})
            for first, second in itertools.pairwise(ids)
        ],
    }


# --------------------------------------------------------------------------
# Console
# --------------------------------------------------------------------------

TAKEN_IDS = {0x2801: "wg-sv3-127", 0x9001: "ntnu-nest-01", 0x9002: "ntnu-nest-02"}
NO_EVENT = {"Heartbeat"}
REPLY_TYPES = {"PlanControl": "op", "PlanDB": "op", "VehicleCommand": "command"}
SPEED_UNITS = {"m/s": 0, "mps": 0, "rpm": 1, "%": 2}


class CommandError(ValueError):
    """A command that the console cannot carry out."""


class Output:
    """Writes JSON lines in a thread, so that a slow reader stops nothing."""

    def __init__(self, stream):
        self.stream = stream
        self.lines = queue.SimpleQueue()
        self.broken = False
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self):
        while True:
            line = self.lines.get()
            if line is None:
                return
            try:
                self.stream.write(line + "\n")
                self.stream.flush()
            except (OSError, ValueError):
                self.broken = True
                return

    def put(self, record):
        """Write one record (a dict) as one line. There is no error."""
        self.lines.put(json.dumps(plain(record), allow_nan=False))

    def close(self):
        """Wait at most 2 seconds until all lines are out."""
        self.lines.put(None)
        self.thread.join(2.0)


class Faults:
    """Decides what happens to the console's own datagrams.

    drop, bad_crc and duplicate are shares from 0 to 1. delay is in seconds.
    Each pair (message name, dst) has its own random sequence, so that the fate
    of the n-th order does not hang on the number of heartbeats.
    """

    def __init__(self, seed, drop, bad_crc, duplicate, delay):
        self.seed, self.delay = seed, delay
        self.shares = {"drop": drop, "bad_crc": bad_crc, "duplicate": duplicate}
        self.streams = {}

    def draw(self, name, dst):
        """Return a dict of fault names and booleans for the next datagram."""
        key = (name, dst)
        if key not in self.streams:
            self.streams[key] = {
                fault: random.Random(f"{self.seed}/{fault}/{name}/{dst}") for fault in self.shares
            }
        return {fault: stream.random() < self.shares[fault] for fault, stream in self.streams[key].items()}


class System:
    """What the console knows of one IMC id. Times are monotonic seconds."""

    def __init__(self, number):
        self.id = number
        self.name = None
        self.announce = None
        self.address = None
        self.source = None
        self.active = True
        self.last_seen = 0.0
        self.counts = {}
        self.last = {}
        self.state = None
        self.position = None
        self.vehicle_state = None
        self.plan_state = None
        self.entities = None
        self.plans = {}
        self.plan_asked = {}
        self.waypoint = None

    @property
    def label(self):
        return self.name if self.name is not None else f"0x{self.id:04x}"


class Console:
    """The console process: sockets, timers, systems, orders."""

    def __init__(self, options, output):
        self.opt = options
        self.out = output
        self.id = options.id
        self.order = "little" if options.swap else "big"
        self.faults = Faults(options.seed, options.drop, options.bad_crc, options.duplicate, options.delay)
        self.systems = {}
        self.external = {}
        self.pending = {}
        self.warned = set()
        self.stats = {
            "sent": {},
            "dropped": {},
            "bad_crc": {},
            "duplicated": {},
            "received": {},
            "bad_datagrams": {},
        }
        self.outbox = []
        self.counter = itertools.count()
        self.next_request = options.first_request_id
        self.heartbeats = True
        self.announces = True
        self.running = True
        self.commands = []
        self.paused_until = None
        self.partial = b""
        self.eof = False
        self.line_number = 0
        self.transport = self._bind([options.port])
        if options.discovery_port == "none":
            self.discovery = None
        elif options.discovery_port is None:
            self.discovery = self._bind(range(30100, 30105))
        else:
            self.discovery = self._bind([int(options.discovery_port)])
        self.port = self.transport.getsockname()[1]
        own = self.discovery.getsockname()[1] if self.discovery else None
        if options.announce_to:
            self.announce_to = options.announce_to
        else:
            self.announce_to = [("127.0.0.1", port) for port in range(30100, 30105) if port != own]
        if options.service:
            self.services = "".join(
                url.replace("{port}", str(self.port)).rstrip(";") + ";" for url in options.service
            )
        else:
            self.services = f"imc+udp://127.0.0.1:{self.port}/;"

    @staticmethod
    def _bind(ports):
        error = None
        for port in ports:
            sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            try:
                sock.bind(("127.0.0.1", port))
            except OSError as problem:
                error = problem
                sock.close()
                continue
            sock.setblocking(False)
            with contextlib.suppress(OSError):
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
            return sock
        raise error

    # ---- output ----------------------------------------------------------

    def event(self, kind, **values):
        if kind not in self.opt.mute:
            self.out.put({"event": kind, "time": round(time.time(), 3), **values})

    def warn(self, system, what, **values):
        key = (system.id, what, values.get("message"))
        if key not in self.warned:
            self.warned.add(key)
            self.event("warning", system=system.label, id=system.id, what=what, **values)

    def count(self, group, name):
        self.stats[group][name] = self.stats[group].get(name, 0) + 1

    # ---- sending ---------------------------------------------------------

    def transmit(self, sock, data, address, name, dst, count=True):
        """Send one datagram through the faults. Return its fate."""
        draw = self.faults.draw(name, dst)
        if draw["drop"]:
            self.count("dropped", name)
            return {"fate": "dropped"}
        if draw["bad_crc"]:
            data = data[:-2] + bytes(octet ^ 0xFF for octet in data[-2:])
            self.count("bad_crc", name)
        copies = 2 if draw["duplicate"] else 1
        if copies == 2:
            self.count("duplicated", name)
        for _ in range(copies):
            if self.faults.delay > 0:
                heapq.heappush(
                    self.outbox,
                    (time.monotonic() + self.faults.delay, next(self.counter), sock, data, address),
                )
            else:
                self._send_now(sock, data, address)
        self.count("sent", name)
        return {"fate": "sent", "bad_crc": draw["bad_crc"], "copies": copies, "delay_s": self.faults.delay}

    def _send_now(self, sock, data, address):
        try:
            sock.sendto(data, address)
        except OSError as error:
            self.event("send_error", to=list(address), error=str(error))

    def send_to(self, system, name, fields=None):
        """Send one message to a system. Return its fate and its octets."""
        if system.address is None:
            raise CommandError(f"{system.label} has announced no imc+udp service on loopback")
        data = encode(name, fields, src=self.id, dst=system.id, order=self.order)
        fate = self.transmit(self.transport, data, system.address, name, system.id)
        return fate, data

    def new_request_id(self):
        number = self.next_request
        self.next_request = number + 1 if number < 0xFFFF else 1
        return number

    def request(self, system, name, fields, request_id=None, then=None):
        """Send a request and remember it. Return what the answer shows of it."""
        request_id = self.new_request_id() if request_id is None else request_id
        fields = {**fields, "type": 0, "request_id": request_id}
        fate, data = self.send_to(system, name, fields)
        op_field = REPLY_TYPES[name]
        op = fields.get(op_field, 0)
        op = op if isinstance(op, str) else enum_name(name, op_field, op)
        now = time.monotonic()
        self.pending[(system.id, name, request_id)] = {
            "system": system.label,
            "id": system.id,
            "message": name,
            "op": op,
            "request_id": request_id,
            "plan_id": fields.get("plan_id"),
            "sent": now,
            "deadline": now + self.opt.reply_timeout,
            "status": "waiting",
            "data": data,
            "fields": fields,
            "then": then,
        }
        return {"message": name, "op": op, "request_id": request_id, "plan_id": fields.get("plan_id"), **fate}

    def send_announce(self):
        if not self.announces:
            return []
        fields = {
            "sys_name": self.opt.name,
            "sys_type": 0,
            "owner": NULL_ID,
            "lat": math.radians(self.opt.lat),
            "lon": math.radians(self.opt.lon),
            "height": 0.0,
            "services": self.services,
        }
        data = encode("Announce", fields, src=self.id, dst=NULL_ID, order=self.order)
        sock = self.discovery or self.transport
        return [
            {
                "to": list(address),
                **self.transmit(sock, data, address, "Announce", f"{address[0]}:{address[1]}"),
            }
            for address in self.announce_to
        ]

    def send_heartbeats(self):
        if not self.heartbeats:
            return
        for system in self.systems.values():
            if system.announce is not None and system.address is not None:
                self.send_to(system, "Heartbeat")

    # ---- receiving -------------------------------------------------------

    def receive(self, sock):
        for _ in range(500):
            try:
                data, source = sock.recvfrom(65535)
            except BlockingIOError:
                return
            except OSError:
                continue
            self.datagram(data, source)

    def bad(self, reason, detail, data, source, header=None):
        self.count("bad_datagrams", reason)
        record = {
            "reason": reason,
            "detail": detail,
            "from": list(source),
            "length": len(data),
            "hex": data[:64].hex(),
        }
        if header:
            record.update(message_id=header["id"], src=header["src"], dst=header["dst"])
        self.event("bad_datagram", **record)

    def datagram(self, data, source):
        """Treat one datagram from source (host, port)."""
        if self._own(source):
            return
        try:
            message = decode(data)
        except ImcError as error:
            self.bad(error.reason, error.detail, data, source, error.header)
            if (
                error.header
                and error.reason == "unknown id"
                and error.header["src"] not in (self.id, NULL_ID)
            ):
                self.touch(error.header["src"], source, f"id {error.header['id']}")
            return
        if len(data) > message.length:
            self.bad(
                "trailing bytes",
                f"{len(data) - message.length} octets after the message",
                data,
                source,
                dataclasses.asdict(message),
            )
        self.count("received", message.name)
        if message.src == self.id:
            self.event("conflict", what="own id", id=self.id, message=message.name, **{"from": list(source)})
            return
        system = self.touch(message.src, source, message.name)
        system.last.setdefault(message.name, {})[message.src_ent] = (message, time.monotonic())
        self.check(system, message)
        handler = getattr(self, "on_" + message.name, None)
        if handler:
            handler(system, message, source)
        elif message.name not in NO_EVENT:
            self.event("message", **self.common(system, message), fields=message.fields)

    def _own(self, source):
        return source in [sock.getsockname() for sock in (self.transport, self.discovery) if sock]

    def common(self, system, message):
        return {
            "system": system.label,
            "id": system.id,
            "message": message.name,
            "timestamp": message.timestamp,
            "src_ent": message.src_ent,
            "dst": message.dst,
            "to_me": message.dst in (self.id, NULL_ID),
            "order": message.order,
        }

    def touch(self, number, source, name):
        """Note that a message of an id came. Return its System."""
        system = self.systems.get(number)
        now = time.monotonic()
        if system is None:
            system = self.systems[number] = System(number)
            if name != "Announce":
                self.event(
                    "unannounced", id=number, id_hex=f"0x{number:04x}", message=name, **{"from": list(source)}
                )
            if number in (0, NULL_ID):
                self.warn(system, "null id as source", message=name)
            if number in TAKEN_IDS:
                self.warn(system, "ghost id", owner=TAKEN_IDS[number])
        elif not system.active:
            system.active = True
            self.event(
                "active", system=system.label, id=number, silent_for_s=round(now - system.last_seen, 3)
            )
        system.last_seen = now
        system.source = source
        system.counts[name] = system.counts.get(name, 0) + 1
        return system

    def check(self, system, message):
        """Warn of values that cannot be right."""
        for field, kind in MESSAGES[message.name][1]:
            value = message.fields[field]
            if kind in ("f32", "f64") and not math.isfinite(value):
                self.warn(system, f"{field} is not finite", message=message.name)
            elif field == "lat" and abs(value) > math.pi / 2 + 1e-9:
                self.warn(system, "lat is out of range (radians)", message=message.name, value=value)
            elif field == "lon" and abs(value) > math.pi + 1e-9:
                self.warn(system, "lon is out of range (radians)", message=message.name, value=value)
            names = ENUMS.get((message.name, field))
            if names and not 0 <= value < len(names):
                self.warn(system, f"{field} has no such value", message=message.name, value=value)

    def on_Announce(self, system, message, source):
        fields = message.fields
        old = system.announce
        system.announce = fields
        system.name = fields["sys_name"]
        for other in self.systems.values():
            if other is not system and other.announce is not None and other.name == system.name:
                self.warn(system, "another id has the same name", other=other.id)
        old_address = system.address
        system.address = choose_address(fields["services"], source)
        if system.address is None:
            self.warn(system, "no imc+udp service on loopback", services=fields["services"])
        if system.position is None or system.position["from"] == "Announce":
            system.position = self.announced_position(fields)
        summary = {**self.summary(system), "from": list(source)}
        if old is None:
            self.event("system", **summary)
        else:
            changed = {
                key: {"was": old[key], "is": fields[key]}
                for key in ("sys_name", "sys_type", "owner", "services")
                if old[key] != fields[key]
            }
            if old_address != system.address:
                changed["address"] = {"was": old_address, "is": system.address}
            self.event("announce", **summary, changed=changed)
        if system.entities is None and system.address is not None:
            self.send_to(system, "EntityList", {"op": "QUERY"})

    @staticmethod
    def announced_position(fields):
        if fields["lat"] == 0.0 or fields["lon"] == 0.0:
            return None
        return {
            "from": "Announce",
            "lat_deg": math.degrees(fields["lat"]),
            "lon_deg": math.degrees(fields["lon"]),
        }

    def on_EntityList(self, system, message, source):
        if message.fields["op"] == 0:
            pairs = [item.partition("=") for item in message.fields["list"].split(";") if item]
            system.entities = {key.strip(): value.strip() for key, _, value in pairs}
            self.event("entities", **self.common(system, message), entities=system.entities)
        else:
            self.event("message", **self.common(system, message), fields=message.fields)

    def on_EstimatedState(self, system, message, source):
        fields = message.fields
        lat, lon = fields["lat"], fields["lon"]
        if all(math.isfinite(fields[key]) for key in ("lat", "lon", "x", "y")):
            lat, lon = displace(lat, lon, fields["x"], fields["y"])
        system.state = {
            "lat_deg": math.degrees(lat),
            "lon_deg": math.degrees(lon),
            "z_m": fields["z"],
            "depth_m": fields["depth"],
            "alt_m": fields["alt"],
            "heading_deg": math.degrees(fields["psi"]) % 360.0,
            "speed_mps": math.hypot(fields["vx"], fields["vy"]),
            "body_speed_mps": math.hypot(fields["u"], fields["v"]),
        }
        if fields["lat"] != 0.0 and fields["lon"] != 0.0:
            system.position = {
                "from": "EstimatedState",
                "lat_deg": system.state["lat_deg"],
                "lon_deg": system.state["lon_deg"],
            }
        self.event("state", **self.common(system, message), **system.state, fields=fields)

    def on_VehicleState(self, system, message, source):
        fields = message.fields
        old = system.vehicle_state
        system.vehicle_state = fields
        keys = ("op_mode", "error_count", "error_ents", "maneuver_type", "flags", "last_error")
        if old is None or any(old[key] != fields[key] for key in keys):
            self.event(
                "mode",
                **self.common(system, message),
                mode=enum_name("VehicleState", "op_mode", fields["op_mode"]),
                was=None if old is None else enum_name("VehicleState", "op_mode", old["op_mode"]),
                maneuver=BY_ID.get(fields["maneuver_type"]),
                changed=[key for key in keys if old is None or old[key] != fields[key]],
                fields=fields,
            )

    def on_PlanControlState(self, system, message, source):
        fields = message.fields
        old = system.plan_state
        system.plan_state = fields
        keys = ("state", "plan_id", "man_id", "man_type", "last_outcome")
        if old is None or any(old[key] != fields[key] for key in keys):
            self.event(
                "mode",
                **self.common(system, message),
                mode=enum_name("PlanControlState", "state", fields["state"]),
                was=None if old is None else enum_name("PlanControlState", "state", old["state"]),
                plan_id=fields["plan_id"],
                man_id=fields["man_id"],
                last_outcome=enum_name("PlanControlState", "last_outcome", fields["last_outcome"]),
                changed=[key for key in keys if old is None or old[key] != fields[key]],
                fields=fields,
            )
        self.follow_plan(system)

    def follow_plan(self, system):
        """Show the active waypoint; ask for the plan if it is not known."""
        state = system.plan_state
        waypoint = None
        if state and state["state"] in (2, 3) and state["plan_id"]:
            plan = system.plans.get(state["plan_id"])
            if plan is not None:
                waypoint = self.find_waypoint(plan, state["plan_id"], state["man_id"])
            elif self.opt.auto_plandb and system.address is not None:
                now = time.monotonic()
                if now - system.plan_asked.get(state["plan_id"], -1e9) >= self.opt.reply_timeout:
                    system.plan_asked[state["plan_id"]] = now
                    record = self.request(system, "PlanDB", {"op": "GET", "plan_id": state["plan_id"]})
                    self.event("asked", system=system.label, id=system.id, why="plan not known", **record)
        if waypoint != system.waypoint:
            system.waypoint = waypoint
            self.event("waypoint", system=system.label, id=system.id, waypoint=waypoint)

    @staticmethod
    def find_waypoint(plan, plan_id, man_id):
        for item in plan["maneuvers"]:
            if item and item[1].get("maneuver_id") == man_id and item[1].get("data"):
                name, data = item[1]["data"]
                if "lat" in data:
                    return {
                        "plan_id": plan_id,
                        "man_id": man_id,
                        "maneuver": name,
                        "lat_deg": math.degrees(data["lat"]),
                        "lon_deg": math.degrees(data["lon"]),
                    }
        return None

    def on_PlanControl(self, system, message, source):
        self.on_reply(system, message)

    on_PlanDB = on_VehicleCommand = on_PlanControl

    def on_reply(self, system, message):
        """Match a reply with its request."""
        name, fields = message.name, message.fields
        kind = enum_name(name, "type", fields["type"])
        if kind == "REQUEST":
            self.event("message", **self.common(system, message), fields=fields)
            return
        op = enum_name(name, REPLY_TYPES[name], fields[REPLY_TYPES[name]])
        record = self.pending.get((system.id, name, fields["request_id"]))
        reason, problems, elapsed = None, [], None
        now = time.monotonic()
        if record is None:
            if any(key[1:] == (name, fields["request_id"]) for key in self.pending):
                reason = "the request went to another system"
            else:
                reason = "no such request"
        elif message.dst not in (self.id, NULL_ID):
            reason = "not to me"
        elif record["op"] != op:
            reason = f"the request was {record['op']}"
        elif record["status"] in ("SUCCESS", "FAILURE"):
            reason = "already answered"
        if record is not None:
            elapsed = round(now - record["sent"], 4)
            if record["plan_id"] is not None and record["plan_id"] != fields.get("plan_id"):
                problems.append("other plan_id")
        late = bool(reason is None and record["status"] == "no reply")
        has_plan = bool(fields["arg"]) and fields["arg"][0] == "PlanSpecification"
        if reason is None and kind == "SUCCESS" and name == "PlanDB" and op == "GET" and not has_plan:
            problems.append("no PlanSpecification")
        self.event(
            "reply",
            **self.common(system, message),
            op=op,
            result=kind,
            request_id=fields["request_id"],
            plan_id=fields.get("plan_id"),
            info=fields["info"],
            matched=reason is None,
            reason=reason,
            late=late,
            problems=problems,
            seconds=elapsed,
            arg=fields.get("arg"),
        )
        if reason is not None:
            return
        record["status"] = kind
        if kind == "IN_PROGRESS":
            record["deadline"] = now + self.opt.reply_timeout
            return
        then, record["then"] = record["then"], None
        if kind == "SUCCESS" and name == "PlanDB":
            self.learn_plan(system, op, record, fields)
        if then and kind == "SUCCESS":
            try:
                self.event("sent", system=system.label, id=system.id, **then())
            except CommandError as error:
                self.event("order_ended", system=system.label, id=system.id, why=str(error))
        elif then:
            self.event(
                "order_ended",
                system=system.label,
                id=system.id,
                why=f"{name} {op} gave {kind}",
                request_id=fields["request_id"],
            )

    def learn_plan(self, system, op, record, fields):
        if op == "GET" and fields["arg"] and fields["arg"][0] == "PlanSpecification":
            system.plans[fields["arg"][1]["plan_id"]] = fields["arg"][1]
        elif op == "SET" and record["fields"].get("arg"):
            system.plans[record["plan_id"]] = record["fields"]["arg"][1]
        elif op == "DEL":
            system.plans.pop(record["plan_id"], None)
        elif op == "CLEAR":
            system.plans.clear()
        self.follow_plan(system)

    def on_LogBookEntry(self, system, message, source):
        self.event(
            "log",
            **self.common(system, message),
            level=enum_name("LogBookEntry", "type", message.fields["type"]),
            fields=message.fields,
        )

    def on_ReportedState(self, system, message, source):
        self.on_external(system, message, message.fields["sid"])

    def on_RemoteSensorInfo(self, system, message, source):
        self.on_external(system, message, message.fields["id"])

    def on_external(self, system, message, name):
        new = name not in self.external
        record = {
            "name": name,
            "by": system.label,
            "by_id": system.id,
            "message": message.name,
            "lat_deg": math.degrees(message.fields["lat"]),
            "lon_deg": math.degrees(message.fields["lon"]),
        }
        self.external[name] = (record, time.monotonic())
        self.event("external", **{**self.common(system, message), **record}, new=new, fields=message.fields)

    # ---- views -----------------------------------------------------------

    def summary(self, system):
        out = {
            "system": system.label,
            "id": system.id,
            "id_hex": f"0x{system.id:04x}",
            "announced": system.announce is not None,
            "active": system.active,
            "address": list(system.address) if system.address else None,
            "on_map": system.announce is not None and system.position is not None,
            "position": system.position,
        }
        if system.announce is not None:
            fields = system.announce
            out.update(
                type=fields["sys_type"],
                type_name=enum_name("Announce", "sys_type", fields["sys_type"]),
                owner=fields["owner"],
                lat_deg=math.degrees(fields["lat"]),
                lon_deg=math.degrees(fields["lon"]),
                height_m=fields["height"],
                services=[url for url in fields["services"].split(";") if url],
            )
        return out

    def find(self, name):
        """Return the System of a name or an id (0x2a00 or 10752)."""
        found = [system for system in self.systems.values() if system.name == name]
        if len(found) == 1:
            return found[0]
        if found:
            raise CommandError(f"{len(found)} ids have the name {name}: use the id")
        try:
            number = int(name, 0)
        except ValueError:
            number = None
        if number in self.systems:
            return self.systems[number]
        raise CommandError(f"no system {name}")

    def commandable(self, name):
        """Return the System, if the console has a definition of it."""
        system = self.find(name)
        if self.opt.vehicle and system.name not in self.opt.vehicle:
            raise CommandError(f"{system.label} has no vehicle definition (--vehicle)")
        return system

    # ---- commands --------------------------------------------------------

    def run_command(self, line):
        """Carry out one line. Print exactly one answer."""
        self.line_number += 1
        word = (line.split() or [""])[0]
        answer = {"answer": word, "n": self.line_number}
        try:
            method = getattr(self, "do_" + word.replace("-", "_"), None) if word else None
            if method is None:
                raise CommandError(f"no command {word!r}: see help")
            rest = line.split(None, 1)[1] if len(line.split(None, 1)) > 1 else ""
            args = rest if word == "send" else shlex.split(rest)
            result = method(args)
        except (ValueError, OverflowError, TypeError, RecursionError) as error:
            self.out.put({**answer, "ok": False, "error": str(error)})
            return
        self.out.put({**answer, "ok": True, **(result or {})})

    @staticmethod
    def split_options(args, names):
        """Part args into plain words and KEY=VALUE options."""
        words, options = [], {}
        for arg in args:
            key, sign, value = arg.partition("=")
            if sign and key in names:
                options[key] = value
            else:
                words.append(arg)
        return words, options

    @staticmethod
    def need(words, low, high, usage):
        if not low <= len(words) <= high:
            raise CommandError("usage: " + usage)

    @staticmethod
    def place(lat, lon):
        """Return (lat, lon) in radians from texts in degrees."""
        lat, lon = float(lat), float(lon)
        if not (abs(lat) <= 90.0 and abs(lon) <= 180.0):
            raise CommandError("LAT and LON are in degrees: -90..90 and -180..180")
        return math.radians(lat), math.radians(lon)

    @staticmethod
    def speed(words):
        """Return (speed, units) from the rest of a command."""
        if not words:
            return 1000.0, 1
        unit = words[1].lower() if len(words) > 1 else "m/s"
        if unit not in SPEED_UNITS:
            raise CommandError("the unit of speed is m/s, rpm or %")
        value = float(words[0])
        if not math.isfinite(value):
            raise CommandError("the speed must be finite")
        return value, SPEED_UNITS[unit]

    def do_systems(self, args):
        now = time.monotonic()
        return {
            "systems": [
                {**self.summary(system), "age_s": round(now - system.last_seen, 3)}
                for system in self.systems.values()
            ],
            "external": [
                {**record, "age_s": round(now - seen, 3)} for record, seen in self.external.values()
            ],
        }

    def do_state(self, args):
        self.need(args, 1, 1, "state NAME")
        system = self.find(args[0])
        now = time.monotonic()
        last = {
            name: {
                str(entity): {
                    "fields": message.fields,
                    "timestamp": message.timestamp,
                    "order": message.order,
                    "age_s": round(now - seen, 3),
                }
                for entity, (message, seen) in entries.items()
            }
            for name, entries in system.last.items()
        }
        vehicle, plan = system.vehicle_state, system.plan_state
        return {
            **self.summary(system),
            "age_s": round(now - system.last_seen, 3),
            "state": system.state,
            "mode": enum_name("VehicleState", "op_mode", vehicle["op_mode"]) if vehicle else None,
            "plan_state": enum_name("PlanControlState", "state", plan["state"]) if plan else None,
            "plan_id": plan["plan_id"] if plan else None,
            "waypoint": system.waypoint,
            "entities": system.entities,
            "plans": sorted(system.plans),
            "counts": system.counts,
            "last": last,
        }

    def order_maneuver(self, system, maneuver, options, prefix):
        """Send a maneuver by one of four ways. Return the answer."""
        via = options.get("via", "inline")
        if via not in ("inline", "plandb", "vehicle", "bare"):
            raise CommandError("via is inline, plandb, vehicle or bare")
        if via == "bare":
            fate, _ = self.send_to(system, *maneuver)
            return {"system": system.label, "via": via, "requests": [{"message": maneuver[0], **fate}]}
        if via == "vehicle":
            record = self.request(
                system, "VehicleCommand", {"command": "EXEC_MANEUVER", "maneuver": maneuver}
            )
            return {
                "system": system.label,
                "via": via,
                "request_id": record["request_id"],
                "requests": [record],
            }
        flags = int(options.get("flags", "0"), 0)
        request_id = self.new_request_id()
        plan_id = options.get("plan", f"{prefix}-{request_id}")
        plan = make_plan(plan_id, [maneuver])
        system.plans.pop(plan_id, None)
        system.plan_asked.pop(plan_id, None)
        start = {"op": "START", "plan_id": plan_id, "flags": flags}
        if via == "inline":
            record = self.request(system, "PlanControl", {**start, "arg": plan}, request_id)
            return {
                "system": system.label,
                "via": via,
                "plan_id": plan_id,
                "request_id": request_id,
                "requests": [record],
            }
        second = self.new_request_id()
        record = self.request(
            system,
            "PlanDB",
            {"op": "SET", "plan_id": plan_id, "arg": plan},
            request_id,
            then=lambda: self.request(system, "PlanControl", start, second),
        )
        return {
            "system": system.label,
            "via": via,
            "plan_id": plan_id,
            "request_id": second,
            "requests": [
                record,
                {
                    "message": "PlanControl",
                    "op": "START",
                    "request_id": second,
                    "plan_id": plan_id,
                    "fate": "waits",
                    "after": request_id,
                },
            ],
        }

    def do_goto(self, args):
        usage = (
            "goto NAME LAT LON [SPEED [m/s|rpm|%]] [via=inline|plandb|vehicle|bare] [plan=ID] [z=M] [flags=N]"
        )
        words, options = self.split_options(args, ("via", "plan", "z", "flags"))
        self.need(words, 3, 5, usage)
        system = self.commandable(words[0])
        lat, lon = self.place(words[1], words[2])
        speed, units = self.speed(words[3:])
        maneuver = (
            "Goto",
            {
                "timeout": 1000,
                "lat": lat,
                "lon": lon,
                "z": float(options.get("z", 0)),
                "z_units": 1,
                "speed": speed,
                "speed_units": units,
            },
        )
        return self.order_maneuver(system, maneuver, options, "goto")

    def do_keep(self, args):
        usage = (
            "keep NAME LAT LON [SPEED [m/s|rpm|%]] [radius=M] [duration=S] [via=...] [plan=ID] [z=M] "
            "[flags=N]"
        )
        words, options = self.split_options(args, ("via", "plan", "z", "flags", "radius", "duration"))
        self.need(words, 3, 5, usage)
        system = self.commandable(words[0])
        lat, lon = self.place(words[1], words[2])
        speed, units = self.speed(words[3:])
        maneuver = (
            "StationKeeping",
            {
                "lat": lat,
                "lon": lon,
                "z": float(options.get("z", 0)),
                "z_units": 1,
                "radius": float(options.get("radius", 10)),
                "duration": int(options.get("duration", 0)),
                "speed": speed,
                "speed_units": units,
            },
        )
        return self.order_maneuver(system, maneuver, options, "keep")

    def do_start(self, args):
        words, options = self.split_options(args, ("flags",))
        self.need(words, 2, 2, "start NAME PLAN [flags=N]")
        system = self.commandable(words[0])
        record = self.request(
            system,
            "PlanControl",
            {"op": "START", "plan_id": words[1], "flags": int(options.get("flags", "0"), 0)},
        )
        return {
            "system": system.label,
            "plan_id": words[1],
            "request_id": record["request_id"],
            "requests": [record],
        }

    def do_stop(self, args):
        self.need(args, 1, 2, "stop NAME [PLAN]")
        system = self.commandable(args[0])
        plan_id = args[1] if len(args) > 1 else ""
        record = self.request(system, "PlanControl", {"op": "STOP", "plan_id": plan_id})
        return {
            "system": system.label,
            "plan_id": plan_id,
            "request_id": record["request_id"],
            "requests": [record],
        }

    def do_abort(self, args):
        self.need(args, 1, 1, "abort NAME")
        system = self.find(args[0])
        fate, _ = self.send_to(system, "Abort")
        return {"system": system.label, "requests": [{"message": "Abort", **fate}]}

    def do_upload(self, args):
        usage = "upload NAME PLAN LAT LON [LAT LON ...] [speed=V] [units=m/s|rpm|%] [z=M]"
        words, options = self.split_options(args, ("speed", "units", "z"))
        if len(words) < 4 or len(words) % 2:
            raise CommandError("usage: " + usage)
        system = self.commandable(words[0])
        rest = [options["speed"], options.get("units", "m/s")] if "speed" in options else []
        speed, units = self.speed(rest)
        maneuvers = []
        for lat, lon in zip(words[2::2], words[3::2], strict=False):
            lat, lon = self.place(lat, lon)
            maneuvers.append(
                (
                    "Goto",
                    {
                        "timeout": 1000,
                        "lat": lat,
                        "lon": lon,
                        "z": float(options.get("z", 0)),
                        "z_units": 1,
                        "speed": speed,
                        "speed_units": units,
                    },
                )
            )
        record = self.request(
            system, "PlanDB", {"op": "SET", "plan_id": words[1], "arg": make_plan(words[1], maneuvers)}
        )
        return {
            "system": system.label,
            "plan_id": words[1],
            "request_id": record["request_id"],
            "requests": [record],
        }

    def do_plandb(self, args):
        self.need(args, 2, 3, "plandb NAME GET|GET_INFO|GET_STATE|GET_DSTATE|DEL|CLEAR|BOOT [PLAN]")
        system = self.find(args[0])
        op = args[1].upper()
        if op == "SET":
            raise CommandError("use upload for SET")
        enum_value("PlanDB", "op", op)
        record = self.request(system, "PlanDB", {"op": op, "plan_id": args[2] if len(args) > 2 else ""})
        return {"system": system.label, "request_id": record["request_id"], "requests": [record]}

    def do_plancontrol(self, args):
        self.need(args, 2, 3, "plancontrol NAME LOAD|GET|START|STOP [PLAN]")
        system = self.find(args[0])
        op = args[1].upper()
        enum_value("PlanControl", "op", op)
        record = self.request(system, "PlanControl", {"op": op, "plan_id": args[2] if len(args) > 2 else ""})
        return {"system": system.label, "request_id": record["request_id"], "requests": [record]}

    def do_entities(self, args):
        self.need(args, 1, 1, "entities NAME")
        system = self.find(args[0])
        fate, _ = self.send_to(system, "EntityList", {"op": "QUERY"})
        return {
            "system": system.label,
            "entities": system.entities,
            "requests": [{"message": "EntityList", "op": "QUERY", **fate}],
        }

    def do_teleop(self, args):
        self.need(args, 2, 2, "teleop NAME on|off")
        system = self.commandable(args[0])
        if args[1] == "on":
            plan_id = "teleoperation-mode"
            record = self.request(
                system,
                "PlanControl",
                {"op": "START", "plan_id": plan_id, "arg": ("Teleoperation", {"custom": f"src={self.id}"})},
            )
            return {
                "system": system.label,
                "plan_id": plan_id,
                "request_id": record["request_id"],
                "requests": [record],
            }
        if args[1] != "off":
            raise CommandError("usage: teleop NAME on|off")
        fate, _ = self.send_to(system, "TeleoperationDone")
        return {"system": system.label, "requests": [{"message": "TeleoperationDone", **fate}]}

    def do_remote(self, args):
        if len(args) < 2 or not all("=" in arg for arg in args[1:]):
            raise CommandError("usage: remote NAME KEY=VALUE ...")
        system = self.commandable(args[0])
        fate, _ = self.send_to(system, "RemoteActions", {"actions": ";".join(args[1:])})
        return {"system": system.label, "requests": [{"message": "RemoteActions", **fate}]}

    def do_send(self, rest):
        parts = rest.split(None, 2)
        if len(parts) < 2:
            raise CommandError("usage: send NAME MESSAGE [JSON-OBJECT]")
        system = self.find(parts[0])
        fields = unplain(json.loads(parts[2])) if len(parts) > 2 else {}
        name = parts[1]
        if name in REPLY_TYPES and fields.get("type", 0) in (0, "REQUEST") and "request_id" not in fields:
            record = self.request(system, name, fields)
            return {"system": system.label, "request_id": record["request_id"], "requests": [record]}
        fate, data = self.send_to(system, name, fields)
        return {"system": system.label, "requests": [{"message": name, "hex": data.hex(), **fate}]}

    def do_resend(self, args):
        self.need(args, 1, 1, "resend REQUEST_ID")
        number = int(args[0], 0)
        found = [record for key, record in self.pending.items() if key[2] == number]
        if not found:
            raise CommandError(f"no request {number}")
        record = found[-1]
        system = self.systems[record["id"]]
        if system.address is None:
            raise CommandError(f"{system.label} has no address")
        fate = self.transmit(self.transport, record["data"], system.address, record["message"], system.id)
        return {
            "system": system.label,
            "request_id": number,
            "requests": [{"message": record["message"], "op": record["op"], "request_id": number, **fate}],
        }

    def do_pending(self, args):
        now = time.monotonic()
        keys = ("system", "id", "message", "op", "request_id", "plan_id", "status")
        return {
            "requests": [
                {**{key: record[key] for key in keys}, "age_s": round(now - record["sent"], 3)}
                for record in self.pending.values()
            ]
        }

    def do_silence(self, args):
        self.heartbeats = False
        return {"heartbeats": False}

    def do_heartbeat(self, args):
        self.heartbeats = True
        return {"heartbeats": True}

    def do_announce(self, args):
        self.need(args, 0, 1, "announce [on|off]")
        if args and args[0] not in ("on", "off"):
            raise CommandError("usage: announce [on|off]")
        if args:
            self.announces = args[0] == "on"
        return {"announces": self.announces, "sent": self.send_announce()}

    def do_raw(self, args):
        self.need(args, 1, 2, "raw HEX [NAME|HOST:PORT]")
        data = bytes.fromhex(args[0])
        if len(args) == 1:
            targets = sorted({system.address for system in self.systems.values() if system.address})
            if not targets:
                raise CommandError("no system has an address: give one")
        else:
            try:
                targets = [parse_address(args[1])]
            except ValueError:
                targets = [self.find(args[1]).address]
                if targets == [None]:
                    raise CommandError(f"{args[1]} has no address") from None
        for target in targets:
            self._send_now(self.transport, data, target)
        return {"to": [list(target) for target in targets], "length": len(data)}

    def do_stats(self, args):
        return {"stats": self.stats}

    def do_wait(self, args):
        self.need(args, 1, 1, "wait SECONDS")
        seconds = float(args[0])
        if not 0 <= seconds <= 3600:
            raise CommandError("SECONDS is from 0 to 3600")
        self.paused_until = time.monotonic() + seconds
        return {"seconds": seconds}

    def do_help(self, args):
        return {"commands": sorted(name[3:] for name in dir(self) if name.startswith("do_"))}

    def do_quit(self, args):
        self.running = False
        return {}

    # ---- loop ------------------------------------------------------------

    def read_input(self, selector):
        chunk = os.read(0, 65536)
        if not chunk:
            self.eof = True
            selector.unregister(0)
            if self.partial:
                self.commands.append(self.partial)
                self.partial = b""
            return
        *lines, self.partial = (self.partial + chunk).split(b"\n")
        self.commands.extend(lines)

    def run(self):
        """Run until quit or the end of standard input. There is no error."""
        selector = selectors.PollSelector()
        selector.register(self.transport, selectors.EVENT_READ, self.transport)
        if self.discovery:
            selector.register(self.discovery, selectors.EVENT_READ, self.discovery)
        selector.register(0, selectors.EVENT_READ, None)
        self.event(
            "ready",
            name=self.opt.name,
            id=self.id,
            id_hex=f"0x{self.id:04x}",
            udp=list(self.transport.getsockname()),
            discovery=list(self.discovery.getsockname()) if self.discovery else None,
            announce_to=[list(address) for address in self.announce_to],
            services=self.services,
            order=self.order,
            pid=os.getpid(),
        )
        next_heartbeat = time.monotonic() + self.opt.heartbeat_period
        next_announce = time.monotonic()
        while self.running and not self.out.broken:
            now = time.monotonic()
            times = [next_heartbeat, next_announce, now + 0.5]
            times += [
                system.last_seen + self.opt.timeout for system in self.systems.values() if system.active
            ]
            times += [
                record["deadline"]
                for record in self.pending.values()
                if record["status"] in ("waiting", "IN_PROGRESS")
            ]
            if self.outbox:
                times.append(self.outbox[0][0])
            if self.paused_until is not None:
                times.append(self.paused_until)
            elif self.commands:
                times.append(now)
            for key, _ in selector.select(max(0.0, min(times) - now)):
                if key.data is None:
                    self.read_input(selector)
                else:
                    self.receive(key.data)
            now = time.monotonic()
            if now >= next_announce:
                self.send_announce()
                next_announce = max(next_announce + self.opt.announce_period, now)
            if now >= next_heartbeat:
                self.send_heartbeats()
                next_heartbeat = max(next_heartbeat + self.opt.heartbeat_period, now)
            self.check_silence(now)
            self.check_replies(now)
            if self.paused_until is not None and now >= self.paused_until:
                self.paused_until = None
            while self.commands and self.running and self.paused_until is None:
                self.run_command(self.commands.pop(0).decode("utf-8", "replace").strip())
            if self.eof and not self.commands and self.paused_until is None:
                self.running = False
            while self.outbox and self.outbox[0][0] <= time.monotonic():
                _, _, sock, data, address = heapq.heappop(self.outbox)
                self._send_now(sock, data, address)
        selector.close()
        self.transport.close()
        if self.discovery:
            self.discovery.close()

    def check_silence(self, now):
        for system in self.systems.values():
            if system.active and now - system.last_seen >= self.opt.timeout:
                system.active = False
                self.event(
                    "silent", system=system.label, id=system.id, silent_for_s=round(now - system.last_seen, 3)
                )

    def check_replies(self, now):
        for record in self.pending.values():
            if record["status"] in ("waiting", "IN_PROGRESS") and now >= record["deadline"]:
                record["status"] = "no reply"
                self.event(
                    "no_reply",
                    **{
                        key: record[key] for key in ("system", "id", "message", "op", "request_id", "plan_id")
                    },
                    seconds=round(now - record["sent"], 3),
                )


# --------------------------------------------------------------------------
# Command line
# --------------------------------------------------------------------------


def parse_address(text):
    """Return (host, port) from "HOST:PORT". HOST must be loopback.

    Raises ValueError if it is not.
    """
    host, sign, port = text.rpartition(":")
    if not sign or not port.isdigit() or not 0 < int(port) < 65536 or not loopback(host):
        raise ValueError(f"{text!r} is no HOST:PORT on loopback")
    return ("127.0.0.1" if host == "localhost" else host), int(port)


def _address(text):
    try:
        return parse_address(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _share(text):
    value = float(text)
    if not 0.0 <= value <= 1.0:
        raise argparse.ArgumentTypeError("a share is from 0 to 1")
    return value


def _positive(text):
    value = float(text)
    if not (value > 0.0 and math.isfinite(value)):
        raise argparse.ArgumentTypeError("the value must be greater than 0")
    return value


def _seconds(text):
    value = float(text)
    if not (value >= 0.0 and math.isfinite(value)):
        raise argparse.ArgumentTypeError("the time must not be negative")
    return value


def _port(text):
    value = int(text)
    if not 0 <= value < 65536:
        raise argparse.ArgumentTypeError("a port is from 0 to 65535")
    return value


def _discovery_port(text):
    return text if text == "none" else _port(text)


def _number16(text):
    value = int(text, 0)
    if not 0 <= value <= 0xFFFF:
        raise argparse.ArgumentTypeError("the value has 16 bits")
    return value


def make_parser():
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        description="An operator's console for IMC on UDP on loopback. See README.md."
    )
    add = parser.add_argument
    add("--name", default="ccu-console-0-1", help="own name (sys_name)")
    add("--id", type=_number16, default=0x4001, help="own IMC id")
    add("--port", type=_port, default=6001, help="own UDP port; 0 takes a free one")
    add(
        "--discovery-port",
        type=_discovery_port,
        default=None,
        metavar="PORT|none",
        help="port that takes Announces; 0 takes a free one; default: first free of 30100-30104",
    )
    add(
        "--announce-to",
        type=_address,
        action="append",
        metavar="HOST:PORT",
        help="where to send own Announces; repeat it; default: 127.0.0.1:30100-30104",
    )
    add(
        "--service",
        action="append",
        metavar="URL",
        help="URL to announce; repeat it; {port} stands for the own port; default: own UDP address",
    )
    add("--lat", type=float, default=0.0, help="own latitude, degrees")
    add("--lon", type=float, default=0.0, help="own longitude, degrees")
    add("--announce-period", type=_positive, default=10.0, help="seconds")
    add("--heartbeat-period", type=_positive, default=1.0, help="seconds")
    add("--timeout", type=_positive, default=2.0, help="seconds until a system counts as silent")
    add("--reply-timeout", type=_positive, default=5.0, help="seconds until a request counts as not answered")
    add("--first-request-id", type=_number16, default=1)
    add(
        "--vehicle",
        action="append",
        metavar="NAME",
        help="a vehicle with a definition; repeat it; default: all systems take orders",
    )
    add(
        "--no-auto-plandb",
        dest="auto_plandb",
        action="store_false",
        help="do not ask for the plan that a system executes",
    )
    add("--mute", action="append", default=[], metavar="EVENT", help="do not print this event; repeat it")
    add("--seed", type=int, default=0, help="seed of the faults")
    add("--drop", type=_share, default=0.0, metavar="P", help="share of own datagrams to lose")
    add("--delay", type=_seconds, default=0.0, metavar="S", help="seconds to hold each own datagram back")
    add("--swap", action="store_true", help="send in the other byte order (little-endian)")
    add("--bad-crc", type=_share, default=0.0, metavar="P", help="share of own datagrams with a wrong CRC")
    add("--duplicate", type=_share, default=0.0, metavar="P", help="share of own datagrams to send twice")
    return parser


def main(argv=None):
    """Run the console. Return the exit code: 0 good, 1 no socket."""
    options = make_parser().parse_args(argv)
    output = Output(sys.stdout)
    try:
        console = Console(options, output)
    except OSError as error:
        output.put({"event": "fatal", "error": str(error)})
        output.close()
        return 1
    with contextlib.suppress(KeyboardInterrupt):
        console.run()
    output.close()
    return 0


if __name__ == "__main__":
    code = main()
    # A reader that has gone must not stop the exit.
    os._exit(code)
