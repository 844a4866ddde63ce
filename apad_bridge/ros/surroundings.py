"""What a supervisor flies with over ROS: the gateway's node, the aPad's link, and what lets time pass."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager

from apad_bridge import building
from apad_bridge.flight import Fleet
from apad_bridge.pace import Pace, WallClock
from apad_bridge.ros.fleet_guard import SecondFleet
from apad_bridge.ros.gateway import GatewayFailed, open_gateway
from apad_bridge.ros.generation_a import GenerationALink, VehicleNotReady
from apad_bridge.ros.ros_pace import FollowedClock, OwnMasterClock
from apad_bridge.runs.failures import PeerFailed
from apad_bridge.runs.flying import Surroundings
from apad_bridge.runs.options import APadKind, RunOptions, TimeSource
from apad_bridge.scenario.schema import Scenario

_READY_S = 15.0


@contextmanager
def open_surroundings(
    scenario: Scenario,
    options: RunOptions,
    fleet: Fleet | None,
    docked: Mapping[int, int],
    now_ms: int,
) -> Iterator[Surroundings]:
    """Everything on the graph while it is entered; PeerFailed, in one line, when something does not come up.

    `docked` are agents by slot that a former supervisor knew to be held; `now_ms` is the mission time to go on from.
    """
    ids = building.agent_ids(scenario)
    battery = scenario.apad.battery
    with ExitStack() as stack:
        try:
            gateway = open_gateway(
                ids,
                scenario.theta,
                node_name="musselbed",
                xmlrpc_port=options.xmlrpc_port,
            )
            stack.callback(gateway.close)
            link = GenerationALink(
                scenario.apad.name,
                ids,
                (battery.empty_v, battery.full_v),
                our_clock=options.apad is APadKind.SIM,
                docked=docked,
                now_ms=now_ms,
            )
            stack.callback(link.close)
            link.wait_until_ready(_READY_S)
        except (SecondFleet, GatewayFailed, VehicleNotReady) as error:
            raise PeerFailed(str(error)) from error
        yield Surroundings(
            link,
            _pace(options, link, now_ms),
            fleet,
            lambda supervisor: (gateway.watcher(supervisor),),
            gateway.event,
            tuple(docked.values()),
        )


def _pace(options: RunOptions, link: GenerationALink, now_ms: int) -> Pace:
    if options.apad is APadKind.SIM:
        return OwnMasterClock(options.speed, link, now_ms)
    if options.time is TimeSource.ROS:
        return FollowedClock(now_ms)
    return WallClock(1.0)
