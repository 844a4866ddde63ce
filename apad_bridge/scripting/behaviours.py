"""Whole behaviours: classes that act at every mission tick until they are done, run by `api.run(...)`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from apad_bridge.mission.values import Event

if TYPE_CHECKING:
    from apad_bridge.scripting.api import Api


class Behaviour:
    """Derive from it and say what `tick` does. What a behaviour remembers is its own, so it can be run again or nested."""

    def begin(self, api: Api) -> None:
        """Before the first tick."""

    def tick(self, api: Api) -> bool:
        """Once a mission second; True when it is done. It may also sleep and wait, which takes as long as it takes."""
        raise NotImplementedError

    def event(self, api: Api, event: Event) -> None:
        """Each event since the tick before, in order."""
