"""The simplest estimator: the belief is the newest packet, and nothing is predicted."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from agents.time_scale import MissionMs, TimeScale
from apad_bridge.beliefs.belief import Belief, Source
from apad_bridge.beliefs.fleet_beliefs import FleetBeliefs
from apad_bridge.beliefs.measurement import HandedOver, Measurement
from firmware_model.packets import NOTHING_REPORTED, Reported, ShortStatus, StatusPacket
from firmware_model.states import State


class LastPacket:
    """An `Estimator` that claims to be certain and learns from packets alone."""

    def predict(self, belief: Belief, to_ms: int) -> Belief:
        return belief

    def update(self, belief: Belief | None, measurement: Measurement, at_ms: MissionMs) -> Belief | None:
        if isinstance(measurement, ShortStatus) and belief is not None:
            short = measurement
            return replace(
                belief, heard_ms=at_ms, state=short.state, primary=short.primary, secondary=short.secondary
            )
        if isinstance(measurement, HandedOver) and belief is not None:
            if measurement.placed:
                return replace(belief, state=State.SLEEPING, learned_from=Source.PACKET)
            return replace(belief, learned_from=Source.PACKET | Source.HAND_OVER)
        if not isinstance(measurement, StatusPacket):
            return belief
        packet = measurement
        return Belief(
            agent_id=packet.agent_id,
            heard_ms=at_ms,
            state=packet.state,
            primary=packet.primary,
            secondary=packet.secondary,
            north_m=packet.north_m,
            east_m=packet.east_m,
            reported=(NOTHING_REPORTED if belief is None else belief.reported).after(packet),
        )

    def kept(self, belief: Belief) -> dict[str, Any]:
        return {
            "heard_ms": belief.heard_ms,
            "state": int(belief.state),
            "charges": [belief.primary, belief.secondary],
            "place_m": [belief.north_m, belief.east_m],
            "reported": belief.reported.stated,
            "learned_from": int(belief.learned_from),
        }

    def restored(self, agent_id: int, data: dict[str, Any]) -> Belief:
        (primary, secondary), (north_m, east_m) = data["charges"], data["place_m"]
        state = State(data["state"])
        reported = Reported(**data["reported"])
        return Belief(
            agent_id=agent_id,
            heard_ms=data["heard_ms"],
            state=state,
            primary=primary,
            secondary=secondary,
            north_m=north_m,
            east_m=east_m,
            learned_from=Source(data["learned_from"]),
            reported=reported,
        )


class HoldLast(FleetBeliefs):
    def __init__(self, agent_ids: Iterable[int], scale: TimeScale | None = None) -> None:
        super().__init__(LastPacket(), agent_ids, scale=scale)
