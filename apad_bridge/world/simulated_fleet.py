"""A flight's aMussels with their host, their coordinator and the water between them; and the file of acoustic links."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from agents.coordinator import Coordinator
from agents.hosting.host import Host
from agents.mussel.outputs import Truth
from agents.mussel.stimuli import AgentStimulus, SoundArrived, WifiArrived
from agents.packet_medium import Medium
from agents.time_scale import AgentMs, MissionMs, TimeScale
from agents.water.medium import PacketEnded, Reception
from agents.water.sea import Station
from agents.water.sea_client import RemoteStation
from agents.water.sea_events import SeaResult
from agents.water.topology import Topology
from apad_bridge.events.mission_events import MissionEnd
from apad_bridge.events.run_events import EndReason
from apad_bridge.events.sound_events import HeardRow, PacketPassed
from apad_bridge.mission.facts import Send
from apad_bridge.scenario.water.links import read_links
from firmware_model.config import Timeslots
from firmware_model.packets.wire import EVERYONE


@dataclass(frozen=True, slots=True)
class Changed:
    """A change of the links file; if it cannot be read, `topology` is None and `problem` gives the reason."""

    topology: Topology | None
    problem: str | None


class LinksFile:
    """A file of links that a person may change during a run.

    A change shows in the file's time and size; a file that cannot be read leaves the links as they were.
    """

    def __init__(self, path: Path, scale: TimeScale) -> None:
        self.path = path
        self._scale = scale
        self._seen = self._stamp()

    def read(self) -> Topology:
        """Reads the links. OSError, or ValueError with `line N: ...`."""
        return read_links(self.path, self._scale)

    def look(self) -> Changed | None:
        """The change since the last look; None without one."""
        stamp = self._stamp()
        if stamp == self._seen:
            return None
        self._seen = stamp
        try:
            return Changed(self.read(), None)
        except OSError as error:
            return Changed(None, f"{error.strerror}: {self.path}")
        except ValueError as error:
            return Changed(None, str(error))

    def _stamp(self) -> tuple[int, int] | None:
        try:
            status = self.path.stat()
        except OSError:
            return None
        return status.st_mtime_ns, status.st_size


class NoModems:
    """No water that carries sound: there is no modem here, and a ping is lost."""

    has_others = False

    def __init__(self) -> None:
        self.all_dropped: Counter[str] = Counter()

    def ping(self, agent_id: int, not_before_ms: int) -> None:
        self.all_dropped["a ping without water to send it through"] += 1

    def cancel_sends(self, agent_id: int) -> None:
        pass

    def carry_apad(self, north_m: float, east_m: float, at_ms: int) -> None:
        pass

    def write(self, agent_id: int, data: bytes) -> None:
        pass

    def leave(self) -> None:
        pass


class WithoutWater(NoModems):
    """Has the verbs of a `Station`. Every packet arrives at once and whole, as in the paper's experiments."""

    def __init__(self, coordinator: Coordinator, host: Host) -> None:
        super().__init__()
        self.advance = coordinator.advance
        self.take_truths = host.take_truths

    def send_sound(self, agent_id: int | None, data: bytes, not_before_ms: int) -> SoundArrived:
        return SoundArrived(data)

    def wifi_reaches(self, agent_id: int, now_ms: MissionMs) -> bool:
        return True

    def set_topology(self, topology: Topology) -> None:
        pass


class FlightFleet:
    """The agents of a flight, their host, the clock authority over them, and the water between them and the aPad."""

    def __init__(
        self,
        coordinator: Coordinator,
        host: Host,
        water: Station | RemoteStation | WithoutWater,
        timeslots: Timeslots | None = None,
        links: LinksFile | None = None,
        sound_m_s: float = math.inf,
    ) -> None:
        """Packets are counted in `timeslots`; `links` is checked at each tick; `sound_m_s` gives the ranges of packets."""
        self.coordinator = coordinator
        self.host = host
        self.close = host.close
        self.water = water
        self._timeslots = timeslots
        self._links = links
        self._sound_m_s = sound_m_s
        self._dropped: Counter[str] = Counter()

    @property
    def ids(self) -> Sequence[int]:
        return self.coordinator.agent_ids

    @property
    def dropped(self) -> Counter[str]:
        """Counts of losses that are not the outcome of a packet."""
        return self.water.all_dropped + self._dropped

    def send(self, send: Send, now_ms: MissionMs) -> AgentStimulus | None:
        """Sends the aPad's packet. Returns the aMussel's stimulus if the packet arrives at once, or else None."""
        if send.medium is Medium.SOUND:
            agent_id = None if send.agent_id == EVERYONE else send.agent_id
            return self.water.send_sound(agent_id, send.data, send.not_before_ms)
        return WifiArrived(send.data) if self.water.wifi_reaches(send.agent_id, now_ms) else None

    def receive(self, agent_id: int, stimulus: AgentStimulus, now_ms: MissionMs) -> int | None:
        """Passes a stimulus to an agent; returns its agent time, or None, counted, for an agent of another fleet."""
        agent_ms = self.coordinator.receive(agent_id, stimulus, now_ms)
        if agent_ms is None:
            self._dropped["for an aMussel that is not of this fleet"] += 1
        return agent_ms

    def mission_ms(self, agent_ms: int) -> MissionMs:
        """The mission time of an agent's output."""
        return self.coordinator.scale.mission_ms(AgentMs(agent_ms))

    def update_links(self) -> Changed | None:
        """Applies a change of the links file, and returns it; None without one."""
        changed = None if self._links is None else self._links.look()
        if changed is not None and changed.topology is not None:
            self.water.set_topology(changed.topology)
        return changed

    def packet_event(self, packet: PacketEnded) -> PacketPassed:
        """The event of a packet that ended. This flight's aPad is 0, and another one -n, the n-th."""
        frame, slots = packet.frame, self._timeslots
        return PacketPassed(
            from_=packet.sender,
            address=frame.destination,
            what=frame.kind.name.lower(),
            bytes=len(frame.data),
            began_ms=packet.began_ms,
            lasted_ms=frame.duration_ms,
            timeslot=None if slots is None else packet.began_ms % slots.frame_ms // slots.slot_ms,
            unsent=packet.unsent,
            heard=[_heard_row(it, self._sound_m_s) for it in packet.receptions],
            data_=frame.data.hex(),
        )

    @property
    def lost(self) -> MissionEnd | None:
        """The mission's end when no agent lives and none can be started again; None as long as one lives."""
        if self.host.lost is not None:
            why = self.host.lost
        elif not self.coordinator.agent_ids:
            why = "every aMussel died too often"
        else:
            return None
        return MissionEnd(EndReason.FLEET_LOST, f"{EndReason.FLEET_LOST}: {why}")


class NoFleet(NoModems):
    """The fleet of a mission alone: its aMussels are in other processes, and nothing reaches them from here."""

    ids: Sequence[int] = ()

    lost: MissionEnd | None = None

    def __init__(self) -> None:
        super().__init__()
        self.water = self
        self.dropped = self.all_dropped

    def advance(self, now_ms: MissionMs) -> Sequence[SeaResult]:
        return ()

    def take_truths(self) -> list[Truth]:
        return []

    def send(self, send: Send, now_ms: MissionMs) -> None:
        return None

    def receive(self, agent_id: int, stimulus: AgentStimulus, now_ms: MissionMs) -> None:
        return None

    def mission_ms(self, agent_ms: int) -> MissionMs:
        raise AssertionError("no agent lives here")

    def update_links(self) -> None:
        return None

    def packet_event(self, packet: PacketEnded) -> PacketPassed:
        raise AssertionError("no packet ends here")

    def close(self) -> None:
        pass


def _heard_row(reception: Reception, sound_m_s: float) -> HeardRow:
    return (
        reception.receiver,
        reception.outcome.name.lower(),
        round(reception.snr_db, 1),
        reception.at_ms,
        round(reception.travelled_us / 1000, 3),
        round(reception.travelled_us * sound_m_s / 1e6, 2),
    )
