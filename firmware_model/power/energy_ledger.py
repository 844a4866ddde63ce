"""A board's energy by module and by state, summed from its actions in closed form."""

from __future__ import annotations

from collections.abc import Iterable

from firmware_model.actions import Action, SetRail, StateChanged
from firmware_model.power.rails import Loads, Rail
from firmware_model.states import State


class EnergyLedger:
    """Sums what the modules draw, from a board's actions in order; docked, a part of that comes from the charger."""

    def __init__(self, loads: Loads, now_ms: int) -> None:
        self._loads = loads
        self._state = State.OFF
        self._since: dict[Rail, int] = {}
        self._entered_ms = now_ms
        self._on_ms: dict[tuple[State, Rail], int] = {}
        self._state_ms: dict[State, int] = {}

    def take(self, actions: Iterable[Action]) -> None:
        for action in actions:
            match action:
                case SetRail(at_ms, rail, True):
                    self._since[rail] = at_ms
                case SetRail(at_ms, rail, _):
                    self._close(rail, self._since.pop(rail), at_ms)
                case StateChanged(at_ms, _, _, new):
                    self.settle(at_ms)
                    self._state = new

    def settle(self, now_ms: int) -> None:
        """Adds everything up to `now_ms` to the sums."""
        for rail, since_ms in self._since.items():
            self._close(rail, since_ms, now_ms)
            self._since[rail] = now_ms
        self._state_ms[self._state] = self._state_ms.get(self._state, 0) + now_ms - self._entered_ms
        self._entered_ms = now_ms

    def power_off(self, now_ms: int) -> None:
        """The board was reset: every rail went off without an action."""
        self.settle(now_ms)
        self._since.clear()
        self._state = State.OFF

    def _close(self, rail: Rail, since_ms: int, now_ms: int) -> None:
        key = (self._state, rail)
        self._on_ms[key] = self._on_ms.get(key, 0) + now_ms - since_ms

    def grains(self) -> dict[tuple[State, Rail], int]:
        """The grains that each module drew in each state."""
        return {key: on_ms * self._loads.of[key[1]] for key, on_ms in self._on_ms.items() if on_ms}

    def by_rail(self) -> dict[Rail, int]:
        grains = self.grains()
        return {
            rail: found for rail in Rail if (found := sum(n for (_, r), n in grains.items() if r is rail))
        }

    def by_state(self) -> dict[State, int]:
        grains = self.grains()
        return {
            state: found for state in State if (found := sum(n for (s, _), n in grains.items() if s is state))
        }

    def state_ms(self) -> dict[State, int]:
        """The time in ms that the board was in each state."""
        return dict(self._state_ms)
