"""Our beliefs of their aMussels, as a supervisor keeps them, and how far they had gone wrong when a packet came."""

from __future__ import annotations

from math import dist, fsum, isnan, sqrt

from agents.time_scale import MissionMs
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.assembly.flight_parts import fleet_beliefs
from apad_bridge.field.field_log.log_facts import BeliefsReport, Place
from apad_bridge.field.shadow.compared import Accuracy
from apad_bridge.scenario.firmware_config import codec_of
from apad_bridge.scenario.schema import Scenario
from firmware_model.packets import ShortStatus, StatusPacket
from firmware_model.states import STATE_OF, State

_TOPIC_PERIOD_MS = 1000
"""An aMussel's own topics come at 10 Hz: as its packets would, they count once a second."""
_FRESH_S = 1.0
"""A supervisor's belief no older than this is what a packet said."""
_ESTIMATED_S = 10.0
"""A belief that is older than this is an estimate, and not the last report."""


class ShadowBeliefs:
    """The beliefs by the newest source: an aMussel's packets, else a supervisor's fresh beliefs, else its own topics.

    Each road of news returns the statuses that were believed.
    """

    def __init__(self, scenario: Scenario) -> None:
        config = flight_config(scenario)
        self.fleet = fleet_beliefs(config)
        self.ids = frozenset(config.ids)
        self._codec = codec_of(scenario)
        self._scale = scenario.time_scale
        self._sends: set[int] = set()
        """aMussels whose packets are heard: their topics, and others' beliefs of them, say nothing more."""
        self._believed: set[int] = set()
        """aMussels of which a supervisor tells its beliefs, and so their states, which their topics lack."""
        self._topics: dict[int, tuple[Place | None, float | None, int]] = {}
        self._errors: list[tuple[float, float, bool | None]] = []

    @property
    def accuracy(self) -> Accuracy:
        count = len(self._errors)
        known = [inside for _, _, inside in self._errors if inside is not None]
        return Accuracy(
            count,
            sqrt(fsum(charge**2 for charge, _, _ in self._errors) / count) if count else None,
            sqrt(fsum(place_m**2 for _, place_m, _ in self._errors) / count) if count else None,
            sum(known) / len(known) if known else None,
        )

    def packet(self, agent_id: int, data: bytes, now_ms: MissionMs) -> list[StatusPacket]:
        self._sends.add(agent_id)
        packet = self._codec.decode(data)
        if isinstance(packet, ShortStatus):
            self.fleet.hear_short(packet, now_ms)
        return self._hear(packet, now_ms) if isinstance(packet, StatusPacket) else []

    def topics(
        self,
        agent_id: int,
        place_m: Place | None,
        charge: float | None,
        *,
        is_docked: bool,
        now_ms: MissionMs,
    ) -> list[StatusPacket]:
        """Their topics carry no state: such an aMussel is taken to float, and to charge while a dock holds it."""
        if agent_id in self._sends or agent_id in self._believed or agent_id not in self.ids:
            return []
        place_before, charge_before, sent_ms = self._topics.get(agent_id, (None, None, -_TOPIC_PERIOD_MS))
        place_m, charge = place_m or place_before, charge_before if charge is None else charge
        is_due = place_m is not None and charge is not None and now_ms >= sent_ms + _TOPIC_PERIOD_MS
        self._topics[agent_id] = place_m, charge, now_ms if is_due else sent_ms
        if not is_due or place_m is None or charge is None:
            return []
        state = State.CHARGING if is_docked else State.FLOATING
        stamp_ms = self._scale.agent_ms(now_ms)
        return self._hear(
            StatusPacket(agent_id, 0, state, charge, 1.0, *place_m, depth_m=0.0, agent_ms=stamp_ms), now_ms
        )

    def of_others(self, report: BeliefsReport, now_ms: MissionMs) -> list[StatusPacket]:
        """A supervisor's fresh belief is what the packet said; nothing else of it counts here, and no row without sense."""
        believed: list[StatusPacket] = []
        for row in report.rows:
            self._believed.add(row.id)
            if row.id in self._sends or not abs(row.age_s) <= _FRESH_S:
                continue
            if row.state not in STATE_OF or isnan(row.charge + row.secondary):
                continue
            stamp_ms = round(self._scale.agent_time(report.mission_ms - 1000 * float(row.age_s)))
            charge, secondary = (min(1.0, max(0.0, float(it))) for it in (row.charge, row.secondary))
            place_m, state = (row.north, row.east), STATE_OF[row.state]
            status = StatusPacket(
                row.id, 0, state, charge, secondary, *place_m, depth_m=0.0, agent_ms=stamp_ms
            )
            believed += self._hear(status, now_ms)
        return believed

    def _hear(self, packet: StatusPacket, now_ms: MissionMs) -> list[StatusPacket]:
        before = self.fleet.get(packet.agent_id) if packet.agent_id in self.ids else None
        if self.fleet.hear(packet, now_ms) is not None:
            return []
        if before is not None and before.age_s(now_ms) >= _ESTIMATED_S:
            place_error_m = dist((before.north_m, before.east_m), (packet.north_m, packet.east_m))
            low, high = before.charge_interval() if before.is_predicted else (0.0, 0.0)
            inside = low <= packet.primary <= high if before.is_predicted else None
            self._errors.append((before.primary - packet.primary, place_error_m, inside))
        return [packet]
