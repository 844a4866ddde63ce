"""The tables of docs/ros-names.md: python -m apad_bridge.ros_names.page"""

from __future__ import annotations

from apad_bridge.ros_names.names import in_full
from apad_bridge.ros_names.table import SECTIONS, Section


def markdown() -> str:
    """Returns all sections, with NAME for an aPad's name and N for an aMussel's id, as on a graph without a namespace."""
    return "\n".join(map(_table, SECTIONS))


def _table(section: Section) -> str:
    lines = [f"## {section.title}", "", "| name | | type | from | when |", "|---|---|---|---|---|"]
    for row in section.rows:
        name = in_full("", row.name.replace("{apad}", "NAME").replace("{id}", "N"))
        lines.append(f"| `{name}` | {row.kind} | {row.type} | {row.who} | {row.when} |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    print(markdown(), end="")
