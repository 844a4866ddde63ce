"""The failure of a firmware's process: a small module, because every agent has it."""

from __future__ import annotations


class FirmwareFailed(Exception):
    """The firmware's process can do no more: its board resets, or stays dead if the process hung."""

    def __init__(self, reason: str, hung: bool = False) -> None:
        super().__init__(reason)
        self.hung = hung
