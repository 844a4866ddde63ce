"""The sensors on a whole board's bus, in the water around its body: for our firmware's log, and for somebody else's."""

from __future__ import annotations

from collections.abc import Callable

from agents.water.fields import WaterFields, unit_noises
from firmware_model.sampling.sensors import SENSORS, Counts, sample


class SensorBus:
    """`seed`, id and a sample's sequence key its noise. `place_um` is the body's at an agent time: north, east, depth."""

    def __init__(
        self, agent_id: int, seed: int, fields: WaterFields, place_um: Callable[[int], tuple[int, int, int]]
    ) -> None:
        self._agent_id = agent_id
        self._seed = seed
        self._fields = fields
        self._place_um = place_um
        self.answers = True
        """False while a defect silences the bus."""

    def read(self, now_ms: int, sequence: int) -> tuple[Counts, int] | None:
        """The counts of all sensors, and a bit by its place for each outside its range; None while they do not answer."""
        if not self.answers:
            return None
        values = self._fields.values_at(*self._place_um(now_ms), now_ms)
        return sample(SENSORS, values, unit_noises(self._seed, self._agent_id, sequence))
