"""Reads a scenario's file of links: cut links with their times, and the loss of each link."""

from __future__ import annotations

from pathlib import Path

from agents.time_scale import TimeScale
from agents.water.sea_events import APAD
from agents.water.topology import Topology, parse_topology
from apad_bridge.scenario.text.text_file import read_text

APAD_NAME = "apad"
"""The name of the aPad in a file of links."""


def read_links(path: Path, scale: TimeScale) -> Topology:
    """Reads a file whose seconds are mission time. Raises OSError, or ValueError, `line N: ...`."""
    return parse_topology(read_text(path), {APAD_NAME: APAD}, scale.agent_span(1000))
