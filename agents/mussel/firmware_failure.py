"""The failures of a firmware's process and of its board's supply: a small module, because every agent has it."""

from __future__ import annotations


class FirmwareFailed(Exception):
    """The firmware's process can do no more: its board resets, or stays dead if the process hung."""

    def __init__(self, reason: str, hung: bool = False, by_watchdog: bool = False) -> None:
        """`hung` in wall time: a failure of the host or of the firmware, which cannot be told apart.

        `by_watchdog` for firmware that never let its own time advance: the board's watchdog is the cause of its reset.
        """
        super().__init__(reason)
        self.hung = hung
        self.by_watchdog = by_watchdog


class PowerLost(Exception):
    """The board's supply failed in the middle of a write to its flash."""
