"""The media that carry packets between an aPad and an aMussel."""

from __future__ import annotations

from enum import StrEnum


class Medium(StrEnum):
    WIFI = "wifi"
    SOUND = "sound"
