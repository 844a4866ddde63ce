"""Choices that a scenario and the command line share. Commands begin without the schema, which takes long to load."""

from __future__ import annotations

from enum import StrEnum


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
