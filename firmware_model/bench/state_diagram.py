"""Draws the transition table as a diagram, and lists rails and numbers, for the pages of the firmware."""

from __future__ import annotations

from enum import IntEnum

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


def numbers(names: type[IntEnum]) -> str:
    """The numbers that firmware tells or switches, each with its name, seven in a line."""
    told = [f"{int(it):2} {it.name}" for it in names]
    width = max(len(it) for it in told) + 2
    rows = (told[n : n + 7] for n in range(0, len(told), 7))
    return "\n".join("".join(f"{it:{width}}" for it in row).rstrip() for row in rows)


def blocks() -> str:
    """Diagram and table as the page shows them."""
    return f"```mermaid\n{mermaid()}\n```\n\n{rails_table()}\n"
