"""Two flights in one sea, which tests fly beside the sea or in other processes: their parts, and what they are asked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from fleets import reporting_every
from hypothesis import strategies as st
from seas import FLEET, SEA

from agents.coordinator import Coordinator
from agents.fleet_config import FleetConfig, resting_on_bottom
from agents.hosting.in_process import InProcessHost
from agents.mussel.outputs import Truth
from agents.mussel.stimuli import ContactClosed
from agents.time_scale import MissionMs
from agents.water.medium import PacketEnded, PacketOutcome
from agents.water.sea import Sea, Station
from agents.water.sea_client import RemoteSea, RemoteStation
from agents.water.sea_events import SeaResult
from agents.water.wifi import Wifi
from firmware_model.packets import CommandPacket, Kind
from firmware_model.packets.codec import MusselbedCodec

DISTURBED = replace(
    SEA, wifi=Wifi(), sound=replace(SEA.sound, range_noise_m=0.1, fading_db=3.0, noise_db_per_hz=50.0)
)
THETA = 60
NORTHS_M = ({1: 100.0, 3: 220.0}, {2: 120.0, 4: 400.0})
"""The aMussels of both flights, in metres north of their aPads' starts."""
Asked = list[tuple[int, int, str]]
"""(tick, aMussel, what the flight of this aMussel does)."""
ASKED: st.SearchStrategy[Asked] = st.lists(
    st.tuples(
        st.integers(0, 20),
        st.integers(1, 4),
        st.sampled_from(["ping", "permission", "range", "dock", "drive", "wifi"]),
    ),
    max_size=10,
)


@dataclass
class Flown:
    """One flight's part of a sea: its aPad's modem, its fleet, and all that came of them."""

    station: Station | RemoteStation
    coordinator: Coordinator
    came: list[SeaResult] = field(default_factory=list)
    truths: list[Truth] = field(default_factory=list)
    reached: list[bool] = field(default_factory=list)
    """For each packet of Wi-Fi, if it got through."""

    def advance(self, now_ms: int) -> list[SeaResult]:
        new = self.station.advance(MissionMs(now_ms))
        self.truths += self.station.take_truths()
        self.came += new
        return new

    def of(self, kind: type) -> list[SeaResult]:
        return [it for it in self.came if isinstance(it, kind)]

    def outcomes(self) -> dict[tuple[int, int], list[tuple[int, PacketOutcome]]]:
        """The (receiver, outcome) of each packet that this flight records, by its sender and its begin."""
        return {
            (it.sender, it.began_ms): [(row.receiver, row.outcome) for row in it.receptions]
            for it in self.of(PacketEnded)
            if isinstance(it, PacketEnded)
        }


def joined(
    sea: Sea | RemoteSea, norths_m: Mapping[int, float], apad_m: float | None, fleet: FleetConfig = FLEET
) -> Flown:
    """A flight with aMussels at these metres to the north, and its aPad's modem as deep as they are."""
    states = {n: resting_on_bottom(metres, 0, 3.0, 0.9, 1.0) for n, metres in norths_m.items()}
    host = InProcessHost(replace(fleet, agent_ids=(1, 2, 3, 4)), states)
    coordinator = Coordinator(host, dict.fromkeys(states, 0), fleet.time_scale)
    flown = Flown(sea.join(coordinator, host), coordinator)
    if apad_m is not None:
        flown.station.carry_apad(apad_m, 0.0, 0)
    return flown


def command(kind: Kind, agent_id: int) -> bytes:
    return MusselbedCodec().encode(CommandPacket(kind, agent_id))


def drifting(sea: Sea | RemoteSea, number: int, at_m: float | None) -> Flown:
    """One of two flights at theta 60 in drifting water, with its aPad at this place; None: without anything."""
    body = replace(FLEET.body, drifts_always=True, drift_amplitude_um=50_000)
    fleet = reporting_every(replace(FLEET, theta=THETA, body=body), 60_000)
    norths_m = {} if at_m is None else {n: at_m + it for n, it in NORTHS_M[number].items()}
    return joined(sea, norths_m, at_m, fleet)


def act(flown: Flown, asked: Asked, at_m: float, now_ms: int) -> None:
    """Runs one tick of a flight, with what it is asked to do at it."""
    flown.advance(now_ms)
    station = flown.station
    for tick, agent_id, what in asked:
        if tick != now_ms // 1000 or agent_id not in flown.coordinator.agent_ids:
            continue
        match what:
            case "range":
                station.ping(agent_id)
            case "dock":
                flown.coordinator.receive(agent_id, ContactClosed(round(1e6 * at_m), 2), MissionMs(now_ms))
            case "drive":
                station.carry_apad(at_m + 100.0 * tick, 0.0, now_ms)
            case "wifi":
                flown.reached.append(station.wifi_reaches(agent_id, MissionMs(now_ms)))
            case _:
                station.send_sound(agent_id, command(Kind[what.upper()], agent_id))


def played(sea: Sea, asked: Asked, wheres_m: Sequence[float | None], order: tuple[int, ...]) -> list[Flown]:
    """An hour and a bit of agent time, with flights at these places, which have their turn in this order at each tick."""
    flights = [drifting(sea, number, at_m) for number, at_m in enumerate(wheres_m)]
    for now_ms in range(0, 70_000, 1000):
        for n in order:
            act(flights[n], asked, wheres_m[n] or 0.0, now_ms)
    return flights
