"""Choices and bounds that a scenario and the command line share. Commands begin without the schema, which loads slowly."""

from __future__ import annotations

from enum import StrEnum

PAPER_DOCKS = 4
MAX_DOCKS = 16
"""More would not fit around a hull of the paper's size."""


class Hosting(StrEnum):
    PROCESSES = "processes"
    ONE_PROCESS = "one_process"


class Generation(StrEnum):
    """The generation of the aPad's software. `auto`: the one that the live graph offers; the simulated aPad is then `a`."""

    AUTO = "auto"
    A = "a"
    """The action `action_server`."""
    B = "b"
    """Mission primitives: services below `commander/primitive`."""
