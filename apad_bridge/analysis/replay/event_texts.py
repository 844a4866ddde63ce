"""Texts for people about lines of the journal: what happened, in one sentence."""

from __future__ import annotations

from apad_bridge.records.event_kinds import EventKind
from apad_bridge.records.journal import Line


def event_text(line: Line) -> str | None:
    """The text of an event that a person may look for in a run; None for lines of samples and for steps of routine."""
    reason = line.get("reason")
    match line["kind"], line:
        case EventKind.DOCK, {"agent": agent, "dock": dock, "closed": closed}:
            return f"dock {dock + 1} {'closed around' if closed else 'let go'} aMussel {agent}"
        case EventKind.PLAN, {"what": what, "strategy": strategy, "steps": steps}:
            return (
                f"plan to {what} by {strategy}: {', '.join(str(step['agent']) for step in steps) or 'nobody'}"
            )
        case EventKind.PRIMITIVE, {"phase": "failed", "name": name}:
            return f"{name} failed: {reason}"
        case EventKind.GIVEN_UP, {"agent": agent, "what": what}:
            return f"gave up to {what} aMussel {agent}: {reason}"
        case EventKind.LEFT_ALONE, {"agent": agent}:
            return f"aMussel {agent} is left alone: {reason}"
        case EventKind.STUCK, _:
            return f"the aPad is stuck: {reason}"
        case EventKind.OVERRIDE, {"taken": taken}:
            return "a person took the aPad over" if taken else "the aPad was given back"
        case EventKind.OPERATOR, {"order": order, "by": by, "agent": agent}:
            return f"{by} ordered: {order}, aMussel {agent}"
        case EventKind.OPERATOR, {"order": order, "by": by}:
            return f"{by} ordered: {order}"
        case EventKind.REMARK, {"text": text, "by": by}:
            return f"{by}: {text}"
        case EventKind.SCRIPT, {"said": said} if said is not None:
            return f"script: {said}"
        case EventKind.DIED, {"id": agent, "gave_up": gave_up}:
            return f"the process of aMussel {agent} died{f': {gave_up}' if gave_up else ', and was started again'}"
        case EventKind.PRESENCE, {"id": agent, "is": presence}:
            return f"aMussel {agent} is {presence}"
        case EventKind.FAULT, {"id": agent, "fault": fault}:
            return f"fault of aMussel {agent}: {fault}"
        case EventKind.REFUSED, {"order": order, "guard": guard}:
            return f"refused to {order}, by the guard {guard}: {reason}"
        case EventKind.GUARD, {"cause": cause, "reaction": reaction}:
            return f"in danger ({cause}): {reaction}, because {reason}"
        case EventKind.GUARD_OVER, {"cause": cause}:
            return f"no longer in danger ({cause})"
        case EventKind.STANDS_DOWN, _:
            return f"the aPad stands down: {reason}"
        case EventKind.MASTER_GONE, _:
            return "the ROS master is gone"
        case EventKind.MASTER_BACK, _:
            return "the ROS master is back"
        case EventKind.VEHICLE_SILENT, _:
            return "the aPad is silent"
        case EventKind.VEHICLE_HEARD, _:
            return "the aPad publishes again"
        case EventKind.RESUMED, _:
            return "another supervisor continued"
        case EventKind.END, _:
            return f"the mission ended: {reason}"
        case _:
            return None
