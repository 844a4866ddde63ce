"""Opens the relay of a flight over ROS: to aMussels, or to a mission, that are in other processes."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

from apad_bridge.mission.sources import Allocation
from apad_bridge.ros.generation_a.contacts_link import ContactsLink
from apad_bridge.ros.links.laboratory import Laboratory
from apad_bridge.ros.links.legacy_link import LegacyLink
from apad_bridge.ros.links.packet_topics import (
    AMusselServices,
    AMusselTopics,
    LegacyOrders,
    PacketTopics,
)
from apad_bridge.scenario.firmware_config import charge_model, codec_of
from apad_bridge.scenario.run_options import BenchPart, RunOptions
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor.packet_relay import (
    FLEET_ALONE,
    FLEET_WITH_DOCKS,
    MISSION_ALONE,
    Division,
    PacketRelay,
    RelayOutcome,
    one_of_several,
    whole_flight,
)
from apad_bridge.world.roster import Presences

_Channel = PacketTopics | AMusselServices | AMusselTopics | LegacyOrders


@dataclass(frozen=True, slots=True)
class RelayParts:
    """The relay to aMussels, or to a mission, that are elsewhere; and what it carries packets by."""

    relay: PacketRelay
    channels: tuple[_Channel, ...]

    @property
    def dropped(self) -> Counter[str]:
        return sum((it.dropped for it in self.channels), self.relay.dropped)

    def close(self) -> None:
        for channel in self.channels:
            channel.close()


def open_relay(
    options: RunOptions,
    scenario: Scenario,
    vehicle: LegacyLink[Any] | ContactsLink,
    presences: Presences,
    allocation: Allocation,
    laboratory: Laboratory,
) -> RelayParts:
    ids, codec = scenario.fleet.ids, codec_of(scenario)
    division = division_of(options, vehicle, presences, allocation)
    topics = PacketTopics(scenario.fleet.all_ids if options.is_one_of_several else ids, division.peers)
    channels: tuple[_Channel, ...] = (topics,)
    if options.part is BenchPart.FLEET:
        channels = (AMusselServices(ids, codec), topics)
    elif options.part is BenchPart.MISSION and not isinstance(vehicle, ContactsLink):
        legacy = AMusselTopics(
            ids, codec, scenario.time_scale, vehicle.holds, topics.senders, charge_model(scenario.board)
        )
        channels = (topics, legacy)
    if options.part is not BenchPart.MISSION:
        channels = (*channels, LegacyOrders(ids, codec, lambda: presences.simulated))
    inlets = [laboratory.take, *(channel.take for channel in channels)]
    relay = PacketRelay(division, inlets, {RelayOutcome.PUBLISH: topics.publish, **laboratory.outlets})
    return RelayParts(relay, channels)


def division_of(
    options: RunOptions, vehicle: LegacyLink[Any] | ContactsLink, presences: Presences, allocation: Allocation
) -> Division:
    if options.is_one_of_several:
        return one_of_several(allocation, lambda: presences.simulated)
    if options.part is BenchPart.FLEET:
        return FLEET_ALONE if isinstance(vehicle, ContactsLink) else FLEET_WITH_DOCKS
    return MISSION_ALONE if options.part is BenchPart.MISSION else whole_flight(lambda: presences.simulated)
