"""The sensors on a whole board's bus, in the water around its body: for our firmware's log, and for somebody else's."""

from __future__ import annotations

from collections.abc import Callable, Container

from agents.mussel.board_parts import BoardPart
from agents.water.fields import WaterFields, unit_noises
from firmware_model.sampling.sensors import SENSORS, Counts, sample


class SensorBus:
    """`seed`, id and a sample's sequence key its noise. `place_um` is the body's at an agent time: north, east, depth."""

    def __init__(
        self,
        agent_id: int,
        seed: int,
        fields: WaterFields,
        place_um: Callable[[int], tuple[int, int, int]],
        failing: Container[BoardPart] = (),
    ) -> None:
        """`failing` are the parts of the board that fail, now and later."""
        self._agent_id = agent_id
        self._seed = seed
        self._fields = fields
        self._place_um = place_um
        self._failing = failing

    def read(self, now_ms: int, sequence: int) -> tuple[Counts, int] | None:
        """The counts of all sensors, and a bit by its place for each outside its range; None while they do not answer."""
        if BoardPart.BUS in self._failing:
            return None
        values = self._fields.values_at(*self._place_um(now_ms), now_ms)
        return sample(SENSORS, values, unit_noises(self._seed, self._agent_id, sequence))
