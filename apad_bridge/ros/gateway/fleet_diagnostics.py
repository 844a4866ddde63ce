"""The statuses on /diagnostics: one for each aMussel, the aPad and the mission, as rqt_runtime_monitor shows them."""

from __future__ import annotations

from math import sqrt

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.ros.gateway.standard_messages import shown
from apad_bridge.ros.system.ros_time import stamp
from apad_bridge.ros_names.shown_fleet import condition_of
from apad_bridge.scenario.blocks.mission_options import Mission
from apad_bridge.supervisor.supervisor import Supervisor


def diagnose(
    supervisor: Supervisor,
    agent_ids: tuple[int, ...],
    rules: Mission,
    now_ms: MissionMs,
    apad: str = "",
    namespace: str = "",
) -> DiagnosticArray:
    """Names the `apad`, if it is one of several, and the `namespace`, because all publish on one topic."""
    beliefs = {belief.agent_id: belief for belief in supervisor.beliefs.all()}
    array = DiagnosticArray(status=[_mission(supervisor, apad), _apad(supervisor, apad)])
    array.header.stamp = stamp(now_ms)
    array.status += [_agent(agent_id, beliefs.get(agent_id), rules, now_ms) for agent_id in agent_ids]
    if namespace:
        for status in array.status:
            status.name, status.hardware_id = (
                f"{namespace}/{status.name}",
                f"{namespace}/{status.hardware_id}",
            )
    return array


def _agent(agent_id: int, belief: Belief | None, rules: Mission, now_ms: MissionMs) -> DiagnosticStatus:
    status = DiagnosticStatus(name=f"musselbed: aMussel {agent_id}", hardware_id=f"amussel{agent_id}")
    status.level, status.message = condition_of(None if belief is None else shown(belief), now_ms, rules)
    if belief is not None:
        status.values = _values(
            state=belief.state.name,
            primary=f"{belief.primary:.3f}",
            secondary=f"{belief.secondary:.3f}",
            last_heard=f"{belief.age_s(now_ms):.0f} s ago",
        )
        if belief.is_predicted:
            status.values += _uncertainty(belief)
    return status


def _uncertainty(belief: Belief) -> list[KeyValue]:
    """The values for which standard messages have no field."""
    low, high = belief.charge_interval()
    (primary, _, secondary), (north, _, east) = belief.charge_cov, belief.place_cov
    clock = belief.clock
    return _values(
        mode=belief.mode.name,
        mode_probability=f"{belief.probability_of(belief.mode):.3f}",
        primary_95=f"{low:.3f} to {high:.3f}",
        primary_deviation=f"{sqrt(primary):.4f}",
        secondary_deviation=f"{sqrt(secondary):.4f}",
        place_deviation=f"{sqrt(north):.2f} m north, {sqrt(east):.2f} m east",
        clock=f"{clock.offset_ms / 1000:+.3f} s, deviation {sqrt(clock.offset_var) / 1000:.3f} s",
        silent_timeslots=belief.silent_timeslots,
        learned_from=" ".join(source.name.lower() for source in belief.learned_from if source.name),
    )


def _apad(supervisor: Supervisor, name: str) -> DiagnosticStatus:
    status = DiagnosticStatus(name=f"musselbed: aPad {name}".rstrip(), hardware_id=name or "apad")
    failure, battery = supervisor.port.first_failure, supervisor.battery
    status.values = _values(primitive=supervisor.primitive)
    if battery is not None:
        status.values += _values(
            voltage=f"{battery.voltage_v:.2f} V", battery=f"{100 * battery.fraction:.0f} %"
        )
    if failure is not None:
        status.level, status.message = DiagnosticStatus.ERROR, f"first failure: {failure.reason}"
    elif supervisor.pose is None:
        status.level, status.message = DiagnosticStatus.STALE, "its position is not known yet"
    else:
        status.level, status.message = DiagnosticStatus.OK, supervisor.primitive
    return status


def _mission(supervisor: Supervisor, apad: str) -> DiagnosticStatus:
    state = supervisor.mission.state
    docks = ("-" if agent_id is None else str(agent_id) for agent_id in supervisor.mission.docks)
    return DiagnosticStatus(
        level=DiagnosticStatus.STALE if supervisor.mission.unheard else DiagnosticStatus.OK,
        name=f"musselbed: mission {apad}".rstrip(),
        message=state.phase_text(supervisor.mission.unheard),
        hardware_id="supervisor",
        values=_values(
            services=state.services,
            way=f"{state.cost_m:.1f} m",
            docks=" ".join(docks),
            dropped_packets=sum(supervisor.dropped.values()),
        ),
    )


def _values(**values: object) -> list[KeyValue]:
    return [KeyValue(key.replace("_", " "), str(value)) for key, value in values.items()]
