"""Choices and bounds that a scenario and the command line share. Commands begin without the schema, which loads slowly."""

from __future__ import annotations

from enum import StrEnum

from firmware_model.entry_points import entry_points

STACKS_GROUP = "musselbed.stacks"
"""The group of entry points by which an installed package brings aPad software of another kind."""
PAPER_DOCKS = 4


class Hosting(StrEnum):
    PROCESSES = "processes"
    ONE_PROCESS = "one_process"


_FURTHER = {
    it.name.upper(): it.name for it in entry_points(STACKS_GROUP) if it.name not in ("auto", "a", "b")
}
"""The names of installed packages' stacks. Ours keep theirs."""


class Generation(StrEnum):
    """The generation of the aPad's software. `auto`: the one that the live graph offers; the simulated aPad is then `a`.

    An installed package's stack has its name after these.
    """

    AUTO = "auto"
    A = "a"
    """The action `action_server`."""
    B = "b"
    """Mission primitives: services below `commander/primitive`."""
    vars().update(_FURTHER)


OWN_GENERATIONS = frozenset({Generation.AUTO, Generation.A, Generation.B})
"""All but those of installed packages."""
