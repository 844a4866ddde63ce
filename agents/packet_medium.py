"""The media that carry packets between an aPad and an aMussel."""

from __future__ import annotations

from enum import StrEnum

from firmware_model.packets.wire import PLAIN, Kind


class Medium(StrEnum):
    WIFI = "wifi"
    SOUND = "sound"


def medium_of(kind: Kind) -> Medium:
    """The medium by which an aPad sends a command without arguments."""
    return Medium.WIFI if PLAIN[kind].by_wifi else Medium.SOUND
