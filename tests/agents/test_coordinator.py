"""The coordinator's laws, with agents as objects and with a host that only notes its grants."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
from fleets import PAPER
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.coordinator import AgentDied, Coordinator
from agents.fleet_config import resting_on_bottom
from agents.hosting.host import Death, Grant, Reply
from agents.hosting.in_process import InProcessHost
from agents.mussel.outputs import Output, Truth, WifiSent
from agents.mussel.stimuli import AgentStimulus, ContactClosed, ContactOpened, SoundArrived
from agents.time_scale import TimeScale
from firmware_model.packets import CommandPacket, Kind
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.stimuli import ResetCause

IDS = (3, 8, 21)
FLEET = PAPER


def fly(
    facts: list[tuple[int, int, AgentStimulus]], cuts: list[int]
) -> tuple[list[Output | AgentDied], dict[int, list[Truth]]]:
    """The outputs up to 40 s of mission time, and each aMussel's truths."""
    initial_states = {agent_id: resting_on_bottom(0.0, agent_id, 3.0, 0.3, 1.0) for agent_id in IDS}
    host = InProcessHost(FLEET, initial_states)
    coordinator = Coordinator(host, dict.fromkeys(IDS, 0), FLEET.time_scale)
    came: list[Output | AgentDied] = []
    for now_ms in sorted({40_000, *cuts, *(fact[0] for fact in facts)}):
        for _, agent_id, stimulus in (fact for fact in facts if fact[0] == now_ms):
            coordinator.receive(agent_id, stimulus, now_ms)
        came += coordinator.advance(now_ms)
    told: dict[int, list[Truth]] = {agent_id: [] for agent_id in IDS}
    for truth in host.take_truths():
        told[truth.agent_id].append(truth)
    return came, told


def command(kind: Kind, agent_id: int) -> SoundArrived:
    return SoundArrived(MusselbedCodec().encode(CommandPacket(kind, agent_id)))


FACTS = st.tuples(
    st.integers(0, 40_000),
    st.sampled_from(IDS),
    st.sampled_from(
        [ContactClosed(1, 2), ContactOpened(), *(command(Kind.PERMISSION, agent_id) for agent_id in IDS)]
    ),
)


@settings(max_examples=40, deadline=None)
@given(facts=st.lists(FACTS, max_size=10), cuts=st.lists(st.integers(0, 40_000), max_size=15))
def test_any_windows_give_the_same_trace(
    facts: list[tuple[int, int, AgentStimulus]], cuts: list[int]
) -> None:
    assert fly(facts, cuts) == fly(facts, [])


class NotingHost:
    """Answers every window with the same next due time or from `outcomes`; a restart returns `gave_up`."""

    def __init__(self, next_due_ms: int | None = None) -> None:
        self.next_due_ms = next_due_ms
        self.granted: list[dict[int, Grant]] = []
        self.deaths: list[int] = []
        self.restarts: list[tuple[int, int, ResetCause]] = []
        self.gave_up: str | None = None

    def grant(self, grants: Mapping[int, Grant]) -> dict[int, Reply | Death]:
        self.granted.append(dict(grants))
        outcomes: dict[int, Reply | Death] = {}
        for agent_id in grants:
            if agent_id in self.deaths:
                self.deaths.remove(agent_id)
                outcomes[agent_id] = Death(ResetCause.WATCHDOG, "stopped")
            else:
                outcomes[agent_id] = Reply(self.next_due_ms, (WifiSent(63 - agent_id, agent_id, b"x"),))
        return outcomes

    def restart(self, agent_id: int, at_ms: int, cause: ResetCause) -> str | None:
        self.restarts.append((agent_id, at_ms, cause))
        return self.gave_up


def test_only_what_is_due_is_granted() -> None:
    host = NotingHost(next_due_ms=300_000)
    coordinator = Coordinator(host, {1: 0, 2: 0}, TimeScale(30))
    coordinator.advance(0)
    assert coordinator.next_due_ms == 10_000 and coordinator.advance(9_999) == []
    coordinator.receive(2, ContactOpened(), 9_999)
    coordinator.advance(9_999)
    coordinator.advance(10_000)
    assert [sorted(grants) for grants in host.granted] == [[1, 2], [2], [1, 2]]


def test_outputs_of_one_mission_millisecond_come_by_agent() -> None:
    """Agent times 61 and 62 are both of the third millisecond at theta 30, and at theta 1 the earlier one comes first."""
    sent = [WifiSent(62, 1, b"x"), WifiSent(61, 2, b"x")]
    assert Coordinator(NotingHost(), {1: 0, 2: 0}, TimeScale(30)).advance(5) == sent
    assert Coordinator(NotingHost(), {1: 0, 2: 0}, TimeScale(1)).advance(100) == sent[::-1]


def test_a_death_takes_the_window_again_after_a_boot_at_its_start() -> None:
    host = NotingHost(next_due_ms=60_000)
    coordinator = Coordinator(host, {1: 0}, TimeScale(30))
    coordinator.advance(1_000)
    host.deaths = [1]
    came = coordinator.advance(2_000)
    assert host.restarts == [(1, 30_000, ResetCause.WATCHDOG)]
    assert [type(it) for it in came] == [WifiSent, AgentDied]
    assert host.granted[1] == host.granted[2] == {1: Grant(60_000)}


def test_an_agent_that_is_given_up_is_out_of_the_fleet() -> None:
    host = NotingHost(next_due_ms=None)
    coordinator = Coordinator(host, {1: 0, 2: 0}, TimeScale(30))
    coordinator.advance(1_000)
    host.deaths, host.gave_up = [1], "it died too often"
    coordinator.receive(1, ContactOpened(), 2_000)
    died = coordinator.advance(2_000)[0]
    assert isinstance(died, AgentDied) and died.gave_up == "it died too often"
    assert coordinator.agent_ids == [2]
    assert coordinator.receive(1, ContactOpened(), 3_000) is None


def test_an_adopted_agent_that_is_ahead_is_never_sent_back() -> None:
    host = NotingHost()
    coordinator = Coordinator(host, {1: 60_000}, TimeScale(30), now_ms=1_000)
    coordinator.receive(1, ContactOpened(), 1_000)
    coordinator.advance(1_000)
    assert host.granted == [{1: Grant(60_000, ((60_000, ContactOpened()),))}]


def test_theta_is_a_positive_integer() -> None:
    with pytest.raises(ValueError, match="theta"):
        Coordinator(NotingHost(), {}, TimeScale(0))
