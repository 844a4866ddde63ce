"""Texts for people about events of the journal: what happened, in one sentence."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from apad_bridge.events.union import EVENTS, text_of
from apad_bridge.records.event_kinds import EventKind
from apad_bridge.vehicle.docking import PRE_EMPTED


def is_failure(kind: str, data: Mapping[str, Any]) -> bool:
    """Tells whether an event is a failure, which a person is told of at once."""
    if kind in EVENTS:
        return EVENTS[kind].of(data).is_failure
    match kind, data:
        case EventKind.PRIMITIVE, {"phase": "failed", "reason": reason}:
            return bool(reason != PRE_EMPTED)
        case _:
            return False


def event_text(kind: str, data: Mapping[str, Any]) -> str | None:
    """The text of an event that a person may look for in a run; None for lines of samples and for steps of routine."""
    if kind in EVENTS:
        return text_of(kind, data)
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
        case EventKind.RESUMED, _:
            return "another supervisor continued"
        case EventKind.END, _:
            return f"the mission ended: {reason}"
        case _:
            return None


def _whose(data: Mapping[str, Any]) -> str:
    """The one whose fault it is, with a blank before it."""
    return f" of aMussel {data['id']}" if "id" in data else " of the aPad"
