"""Draws the transition table as a diagram and lists the rails by state, for docs/firmware-states.md."""

from __future__ import annotations

from firmware_model.power.rails import RAILS, Rail
from firmware_model.states import TABLE, State, Trigger


def mermaid() -> str:
    """The table as a Mermaid state diagram: an arrow for each pair of states, with all its triggers."""
    arrows: dict[tuple[State, State], list[Trigger]] = {}
    for (state, trigger), new in TABLE.items():
        arrows.setdefault((state, new), []).append(trigger)
    lines = ["stateDiagram-v2", f"    [*] --> {State.OFF.name}"]
    for (state, new), triggers in sorted(arrows.items()):
        names = ", ".join(trigger.name for trigger in sorted(triggers))
        lines.append(f"    {state.name} --> {new.name}: {names}")
    return "\n".join(lines)


def rails_table() -> str:
    """The modules that are on in each state, as a Markdown table."""
    lines = ["| state | on |", "|---|---|"]
    for state in State:
        names = [f"`{rail.name}`" for rail in Rail if RAILS[state] >> rail & 1]
        lines.append(f"| `{state.name}` | {', '.join(names) or 'nothing'} |")
    return "\n".join(lines)


def blocks() -> str:
    """Diagram and table as the page shows them."""
    return f"```mermaid\n{mermaid()}\n```\n\n{rails_table()}\n"
