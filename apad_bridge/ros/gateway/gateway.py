"""The one ROS node of a supervisor: publishes and serves the aMussels to an aPad, and the flight's state to people.

    gateway = open_gateway(agent_ids, theta, node_name="musselbed_1", xmlrpc_port=0, truth=None)
    FlightContext(..., watchers=lambda supervisor: (gateway.watcher(supervisor),))  # after each tick
    gateway.event(at_ms, event)                              # as a Recorder's: /musselbed/mission
    gateway.close()

`open_gateway` raises SecondFleet or GatewayFailed (one line each) before anything is on the graph. ROS_MASTER_URI and
ROS_IP come from the process's environment. A process has one node: it can open one gateway.

rospy's threads answer services from the last tick's snapshot, which is replaced and never changed. No publisher waits: a
stalled reader loses the oldest messages of the fleet's topics; of an aMussel's (`agent_topics`) the newest, then its
connection.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import rosgraph
import rospy

from agents.hosting.descriptors import raise_descriptor_limit
from agents.time_scale import MissionMs, TimeScale
from apad_bridge.beliefs.belief import NUMBERS, Belief
from apad_bridge.doctor.network import Unreachable
from apad_bridge.events.event import Event
from apad_bridge.events.sound_events import PacketPassed
from apad_bridge.records.packet_lines import SoundRow, sound_rows
from apad_bridge.records.samples import belief_sample
from apad_bridge.ros.gateway.agent_topics import AgentReport, AgentTopics
from apad_bridge.ros.gateway.fleet_guard import refuse_second_fleet
from apad_bridge.ros.gateway.standard_messages import header
from apad_bridge.ros.system.lost_links import bound_calls
from apad_bridge.ros.system.node import ned_frame, start_node
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import of_amussel, ours
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.supervisor.context import Watcher
from apad_bridge.supervisor.forecast import Forecast
from apad_bridge.supervisor.supervisor import Supervisor

use_generated_messages()

from misc_msgs.srv import (  # noqa: E402
    GetChargeInfo,
    GetChargeInfoResponse,
    GetPosition,
    GetPositionResponse,
    GetSensoryReading,
    GetSensoryReadingResponse,
    SendEnergy,
    SendEnergyResponse,
)
from musselbed_msgs.msg import AgentBelief, APadStatus, FleetBeliefs, MissionEvent  # noqa: E402
from musselbed_msgs.msg import Forecast as ForecastMessage  # noqa: E402
from underwater_msgs.msg import MediumTransmission  # noqa: E402

_FLEET_QUEUE = 10
_EVENT_QUEUE = 1000
"""Events are not repeated: a slow reader should still receive those of a whole mission."""

TrueReports = Callable[[MissionMs], Mapping[int, AgentReport]]
"""The truth of each aMussel at a mission time, which `records.truth_on_agent_topics` publishes instead of the beliefs."""


class GatewayFailed(Exception):
    """One line: the reason why the node could not come up, and the mend."""


def open_gateway(
    agent_ids: Iterable[int],
    scale: TimeScale,
    *,
    node_name: str,
    xmlrpc_port: int = 0,
    truth: TrueReports | None = None,
    simulated: Callable[[], frozenset[int]] | None = None,
    remappings: Sequence[str] = (),
    is_resumed: bool = False,
    frame: LocalFrame | None = None,
) -> Gateway:
    """Puts the node on the graph, with the aMussels' topics and services. Raises SecondFleet or GatewayFailed.

    `frame` gives the aMussels' topics their place on the globe; without one they have none. `remappings` are ROS's,
    `FROM:=TO`, for all names of the process. A resumed fleet (`is_resumed`) is not refused where another node publishes its
    aMussels: the claims settle that.
    """
    ids = list(agent_ids)
    raise_descriptor_limit()
    master_uri = rosgraph.get_master_uri()
    try:
        refuse_second_fleet(rospy.resolve_name(node_name), [] if is_resumed else ids, master_uri)
        bound_calls()
        start_node(node_name, remappings, xmlrpc_port=xmlrpc_port, log_level=rospy.WARN)
    except (OSError, Unreachable) as error:
        raise GatewayFailed(
            f"no ROS master answers at {master_uri} ({error}): is it running, and is ROS_MASTER_URI right?"
        ) from error
    except rospy.ROSException as error:
        raise GatewayFailed(f"the ROS node {node_name} could not start: {error}") from error
    return Gateway(ids, scale, truth, simulated, frame)


class Gateway:
    """Owned by the flight's thread; the node is initialised before (`open_gateway`)."""

    def __init__(
        self,
        agent_ids: Iterable[int],
        scale: TimeScale,
        truth: TrueReports | None = None,
        simulated: Callable[[], frozenset[int]] | None = None,
        frame: LocalFrame | None = None,
    ) -> None:
        """Only `simulated` aMussels get topics of their own: a real one publishes its own position."""
        self._scale = scale
        self._simulated = simulated
        self._truth = truth
        self._shown: Mapping[int, AgentReport] = MappingProxyType({})
        self._ned = ned_frame()
        ids = list(agent_ids)
        self.agent_topics = AgentTopics(ids, frame)
        self._beliefs = _publisher(ours("beliefs"), FleetBeliefs, _FLEET_QUEUE)
        self._apad = _publisher(ours("apad"), APadStatus, _FLEET_QUEUE)
        self._events = _publisher(ours("mission"), MissionEvent, _EVENT_QUEUE)
        self._forecast = _publisher(ours("forecast"), ForecastMessage, _FLEET_QUEUE)
        self._sound = _publisher(ours("sound"), MediumTransmission, _EVENT_QUEUE)
        self._services = [
            rospy.Service(of_amussel(agent_id, name), kind, self._service(agent_id, answer))
            for agent_id in ids
            for name, (kind, answer) in _SERVICES.items()
        ]

    def watcher(self, supervisor: Supervisor) -> Watcher:
        """Publishes the supervisor's beliefs at each tick."""

        def watch(now_ms: MissionMs) -> None:
            beliefs = supervisor.beliefs.all()
            if self._truth is None:
                shown: Mapping[int, AgentReport] = {it.agent_id: AgentReport.of_belief(it) for it in beliefs}
            else:
                shown = self._truth(now_ms)
            if self._simulated is not None:
                ours = self._simulated()
                shown = {agent_id: it for agent_id, it in shown.items() if agent_id in ours}
            self._shown = MappingProxyType(dict(shown))
            self.agent_topics.show(now_ms, self._shown)
            self._show_beliefs(beliefs, now_ms)
            self._show_apad(supervisor, now_ms)

        return watch

    def event(self, at_ms: int, event: Event) -> None:
        """Publishes an event of the mission on /musselbed/mission; a packet of sound on /musselbed/sound as well."""
        if isinstance(event, PacketPassed) and self._sound.get_num_connections() > 0:
            for row in sound_rows(event):
                self._sound.publish(_transmission(row, at_ms, self._ned))
        if event.is_for_journal_alone or self._events.get_num_connections() == 0:
            return
        message = MissionEvent(mission_time_ms=at_ms, kind=event.kind, data=json.dumps(event.data))
        message.header = header(at_ms, self._ned)
        self._events.publish(message)

    def show_forecast(self, now_ms: int, forecast: Forecast) -> None:
        """Publishes the forecast of a tick on /musselbed/forecast; NaN for what cannot be foretold."""
        if self._forecast.get_num_connections() == 0:
            return
        values = {
            name: math.nan if value is None else value for name, value in dataclasses.asdict(forecast).items()
        }
        message = ForecastMessage(mission_time_ms=now_ms, **values)
        message.header = header(now_ms, self._ned)
        self._forecast.publish(message)

    def close(self) -> None:
        """Leaves the graph. The process cannot open another gateway."""
        self.agent_topics.close()
        rospy.signal_shutdown("the flight is over")

    def _show_beliefs(self, beliefs: list[Belief], now_ms: MissionMs) -> None:
        if self._beliefs.get_num_connections() == 0:
            return
        message = FleetBeliefs(mission_time_ms=now_ms, agent_time_ms=self._scale.agent_ms(now_ms))
        message.header = header(now_ms, self._ned)
        message.reported_names = [*NUMBERS]
        message.agents = [AgentBelief(*belief_sample(it, now_ms)) for it in beliefs]
        self._beliefs.publish(message)

    def _show_apad(self, supervisor: Supervisor, now_ms: int) -> None:
        pose, battery = supervisor.pose, supervisor.battery
        if self._apad.get_num_connections() == 0 or pose is None:
            return
        message = APadStatus(mission_time_ms=now_ms, primitive=supervisor.primitive)
        message.header = header(now_ms, self._ned)
        message.north, message.east, message.heading = pose.north_m, pose.east_m, pose.heading_rad
        if battery is not None:
            message.voltage, message.battery_fraction = battery.voltage_v, battery.fraction
        message.docks = [-1 if agent_id is None else agent_id for agent_id in supervisor.mission.docks]
        self._apad.publish(message)

    def _service(self, agent_id: int, answer: Callable[[AgentReport], Any]) -> Callable[[Any], Any]:
        def serve(_: Any) -> Any:
            if (shown := self._shown.get(agent_id)) is None:
                raise rospy.ServiceException(f"amussel{agent_id} has not been heard yet")
            return answer(shown)

        return serve


def _charge_info(shown: AgentReport) -> GetChargeInfoResponse:
    return GetChargeInfoResponse(
        battery_level=100 * shown.charge,
        x=shown.north_m,
        y=shown.east_m,
        z=shown.depth_m,
        type="consumer",
        consumers=[],
    )


def _position(shown: AgentReport) -> GetPositionResponse:
    return GetPositionResponse(shown.north_m, shown.east_m, shown.depth_m)


_SERVICES: dict[str, tuple[Any, Callable[[AgentReport], Any]]] = {
    "get_battery_level": (GetChargeInfo, _charge_info),
    "charge_info": (GetChargeInfo, _charge_info),
    "get_position": (GetPosition, _position),
    # No packet has a current: legacy controllers ignore a reading that is not two numbers.
    "get_sensory_reading": (GetSensoryReading, lambda shown: GetSensoryReadingResponse([])),
    # No coil is switched on by a call: the board charges as long as a dock holds the aMussel.
    "send_energy": (SendEnergy, lambda shown: SendEnergyResponse(False)),
}
"""The legacy services of an aMussel: the type, and how the newest report answers."""


def _publisher(topic: str, kind: Any, queue_size: int) -> rospy.Publisher:
    return rospy.Publisher(topic, kind, queue_size=queue_size)


def _transmission(row: SoundRow, now_ms: int, frame: str) -> MediumTransmission:
    """The same message as in the bag: see `SoundRow`."""
    message = MediumTransmission(
        message=row.message,
        duration=row.duration_s,
        sender=row.sender,
        receiver=row.receiver,
        snr=row.snr_db,
        range=row.range_m,
        listener_id=row.listener,
        conflict=row.conflict,
    )
    message.header = message.position.header = header(now_ms, frame)
    return message
