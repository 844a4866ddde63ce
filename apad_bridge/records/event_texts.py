"""Texts for people about events of the journal: what happened, in one sentence."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from apad_bridge.events import EVENTS
from apad_bridge.records.event_kinds import EventKind
from apad_bridge.vehicle.docking import PRE_EMPTED

_REACTIONS = {
    "hold": "the aPad holds where it is",
    "stop": "the aPad's controllers go off",
    "return": "the aPad goes back inside the fence",
}
"""The reaction to a danger, by the `reaction` of the event `guard`."""

_STOP_STATES = {
    "ordered": "is ordered",
    "sent": "is sent",
    "taken": "is taken by the aPad",
    "at rest": "has brought the aPad to rest",
    "not taken": "is NOT TAKEN by the aPad",
    "refused": "is refused",
}


def is_failure(kind: str, data: Mapping[str, Any]) -> bool:
    """Tells whether an event is a failure, which a person is told of at once."""
    if kind in EVENTS:
        return EVENTS[kind].is_failure
    match kind, data:
        case EventKind.PRIMITIVE, {"phase": "failed", "reason": reason}:
            return bool(reason != PRE_EMPTED)
        case EventKind.REFUSED, {"order": order}:
            return bool(
                order == "permit to surface"
            )  # any other order that is refused fails as a primitive, too
        case (
            (EventKind.GUARD | EventKind.PILOT | EventKind.OTHERS),
            _,
        ):
            return True
        case EventKind.STOP, {"state": "not taken" | "refused"}:
            return True
        case _:
            return False


def event_text(kind: str, data: Mapping[str, Any]) -> str | None:
    """The text of an event that a person may look for in a run; None for lines of samples and for steps of routine."""
    if kind in EVENTS:
        return EVENTS[kind].of(data).text()
    reason = data.get("reason")
    match kind, data:
        case EventKind.DOCK, {"agent": agent, "dock": dock, "closed": closed}:
            return f"dock {dock + 1} {'closed around' if closed else 'let go'} aMussel {agent}"
        case EventKind.PLAN, {"what": what, "strategy": strategy, "steps": steps}:
            whom = ", ".join(str(step["agent"]) for step in steps) or "nobody"
            released = ", ".join(str(it["released"]) for it in data.get("exchanged", ()))
            return (
                f"plan to {what} by {strategy}: {whom}{f', in exchange for {released}' if released else ''}"
            )
        case EventKind.PRIMITIVE, {"phase": "failed", "name": name, "agent": agent, "dock": dock}:
            return f"{name} (aMussel {agent}, dock {dock + 1}) failed: {reason}"
        case EventKind.PRIMITIVE, {"phase": "failed", "name": name, "north_m": north_m, "east_m": east_m}:
            return f"{name} ({north_m:.1f} m north, {east_m:.1f} m east) failed: {reason}"
        case EventKind.PRIMITIVE, {"phase": "failed", "name": name}:
            return f"{name} failed: {reason}"
        case EventKind.OPERATOR, {"order": order, "by": by, "agent": agent}:
            return f"{by} ordered: {order}, aMussel {agent}"
        case EventKind.OPERATOR, {"order": order, "by": by}:
            return f"{by} ordered: {order}"
        case EventKind.REMARK, {"text": text, "by": by}:
            return f"{by}: {text}"
        case EventKind.SCRIPT, {"said": said} if said is not None:
            return f"script: {said}"
        case EventKind.PRESENCE, {"id": agent, "is": presence}:
            return f"aMussel {agent} is {presence}"
        case EventKind.FAULT, {"fault": fault, "refused": refused}:
            return f"fault{_whose(data)} did not begin: {fault}, {refused}"
        case EventKind.FAULT, {"fault": fault}:
            value = f", {data['value']:g}" if "value" in data else ""
            return f"fault{_whose(data)}: {fault}{value}"
        case EventKind.FAULT_OVER, {"fault": fault}:
            return f"fault{_whose(data)} healed: {fault}"
        case EventKind.REFUSED, {"order": "permit to surface", "agent": agent}:
            return f"aMussel {agent} is not permitted to surface: {reason}"
        case EventKind.REFUSED, {"order": order, "guard": guard}:
            return f"refused to {order}, by the guard {guard}: {reason}"
        case EventKind.GUARD, {"reaction": reaction, "calls_pilot": calls_pilot} if reaction in _REACTIONS:
            return f"{'PILOT, TAKE IT: ' if calls_pilot else ''}{_REACTIONS[reaction]}: {reason}"
        case EventKind.GUARD_OVER, {"cause": cause}:
            return f"no longer in danger ({cause})"
        case EventKind.STOP, {"number": number, "mode": mode, "by": by, "state": state}:
            why = f": {reason}" if reason else ""
            alarm = "USE THE VEHICLE'S SWITCH: " if state == "not taken" else ""
            return f"{alarm}stop {number} ({mode}, by {by}) {_STOP_STATES.get(state, state)}{why}"
        case EventKind.CONTINUED, {"number": number, "by": by}:
            return f"{by} continues after stop {number}"
        case EventKind.BACK_IN, {"by": by, "lookout": lookout}:
            return f"{by} sends the aPad back inside the fence, {lookout} watches the water"
        case EventKind.DRIFT, {"speed_m_s": speed_m_s, "towards_rad": towards_rad, "fence_s": fence_s}:
            degrees = round(math.degrees(towards_rad)) % 360
            limit = "" if fence_s is None else f", at the fence or a keep-out zone in {fence_s:.0f} s"
            return f"the aPad drifts without thrust, {speed_m_s:.2f} m/s towards {degrees} degrees{limit}"
        case EventKind.PILOT, {"steers": None}:
            return (
                "whether a pilot steers the aPad cannot be told: nobody publishes the pilot's flag any more"
            )
        case EventKind.PILOT, {"steers": steers}:
            return "a pilot steers the aPad" if steers else "the pilot has let go of the aPad"
        case EventKind.OTHERS, {"client": client}:
            return f"{client or 'a client that this stack does not name'} commands the aPad"
        case EventKind.RESUMED, _:
            return "another supervisor continued"
        case EventKind.END, _:
            return f"the mission ended: {reason}"
        case _:
            return None


def _whose(data: Mapping[str, Any]) -> str:
    """The one whose fault it is, with a blank before it."""
    return f" of aMussel {data['id']}" if "id" in data else " of the aPad"
