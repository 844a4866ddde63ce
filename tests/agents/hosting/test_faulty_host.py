"""A host behind defects: what is lost, late or changed on a link, however time is cut; and nothing without a defect."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
from fleets import PAPER
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.coordinator import AgentDied, Coordinator
from agents.fleet_config import resting_on_bottom
from agents.hosting.faulty_host import FaultyHost, LinkDefect
from agents.hosting.host import Death, Grant, Reply
from agents.hosting.in_process import InProcessHost
from agents.mussel.outputs import Output, StimulusDropped, Truth, WifiSent
from agents.mussel.stimuli import AgentStimulus, PingArrived, SoundArrived, WifiArrived
from agents.time_scale import TimeScale
from firmware_model.stimuli import ResetCause

END_MS = 100_000
DELAY_MS = 7_000


class Echo:
    """A host whose one agent sends by Wi-Fi each packet that reaches it, when it does; its next window may die."""

    lost = None
    pids: Mapping[int, int] = {}

    def __init__(self) -> None:
        self.dies = False

    def kill(self, agent_id: int) -> None:
        self.dies = True

    def stop(self, agent_id: int) -> None:
        pass

    def grant(self, grants: Mapping[int, Grant]) -> dict[int, Reply | Death]:
        if self.dies:
            self.dies = False
            return dict.fromkeys(grants, Death(ResetCause.BROWN_OUT, "killed"))
        return {n: Reply(None, tuple(_echoes(it))) for n, it in grants.items()}

    def restart(self, agent_id: int, at_ms: int, cause: ResetCause) -> str | None:
        return None

    def take_truths(self) -> list[Truth]:
        return []

    def close(self) -> None:
        pass


def _echoes(grant: Grant) -> list[Output]:
    assert list(grant.stimuli) == sorted(grant.stimuli, key=lambda it: it[0])
    assert all(at_ms <= grant.until_ms for at_ms, _ in grant.stimuli)
    return [
        WifiSent(at_ms, 1, it.data)
        for at_ms, it in grant.stimuli
        if isinstance(it, WifiArrived | SoundArrived)
    ]


def heard(
    defects: Mapping[LinkDefect, float],
    sent: list[tuple[int, AgentStimulus]],
    cuts: list[int],
    killed: bool = False,
) -> list[tuple[int, Output]]:
    """What comes back from the echo, with its time, of packets sent at these times."""
    echo = Echo()
    host = FaultyHost(echo, seed=1)
    for defect, value in defects.items():
        host.set_defect(1, defect, value)
    coordinator, came = Coordinator(host, {1: 0}, TimeScale(1)), list[tuple[int, Output]]()
    moments: list[tuple[int, AgentStimulus | None]] = [*sent, *((cut, None) for cut in (*cuts, END_MS))]
    for at_ms, stimulus in sorted(moments, key=lambda it: it[0]):
        if killed and stimulus is None:
            echo.kill(1)
        came += [(it.at_ms, it) for it in coordinator.advance(at_ms) if not isinstance(it, AgentDied)]
        if stimulus is not None:
            coordinator.receive(1, stimulus, at_ms)
    return came


TIMES = st.integers(0, END_MS // 2)
PACKETS = st.lists(
    st.tuples(TIMES, st.binary(min_size=1, max_size=20).map(WifiArrived)),
    max_size=8,
    unique_by=lambda it: it[0],
)


@settings(deadline=None)
@given(sent=PACKETS, cuts=st.lists(TIMES, max_size=10), killed=st.booleans())
def test_late_packets_all_come_once_in_order_and_as_late(
    sent: list[tuple[int, AgentStimulus]], cuts: list[int], killed: bool
) -> None:
    came = heard({LinkDefect.DELAY: DELAY_MS}, sent, cuts, killed)
    # Late on the way there, and on the way back.
    expected = [(at_ms + 2 * DELAY_MS, it) for at_ms, it in sorted(sent, key=lambda it: it[0])]
    assert [(at_ms, it.data) for at_ms, it in came if isinstance(it, WifiSent)] == [
        (at_ms, it.data) for at_ms, it in expected if isinstance(it, WifiArrived)
    ]


@settings(deadline=None)
@given(sent=PACKETS, cuts=st.lists(TIMES, max_size=10))
def test_flipped_bits_do_not_depend_on_how_time_is_cut(
    sent: list[tuple[int, AgentStimulus]], cuts: list[int]
) -> None:
    flips = {LinkDefect.FLIPS: 0.2}
    assert heard(flips, sent, cuts) == heard(flips, sent, [])
    assert heard({LinkDefect.FLIPS: 0.0}, sent, cuts) == heard({}, sent, [])


SENT: list[tuple[int, AgentStimulus]] = [(1, WifiArrived(b"a")), (2, SoundArrived(b"b")), (3, PingArrived(5))]
LOST = "a packet on a link that was cut"


@pytest.mark.parametrize(
    ("defect", "sent", "came"),
    [
        pytest.param(
            LinkDefect.FLIPS,
            [(5, WifiArrived(b"\x00\xf0"))],
            [WifiSent(5, 1, b"\x00\xf0")],
            id="every bit flips, there and back",
        ),
        pytest.param(
            LinkDefect.CUT,
            SENT,
            [StimulusDropped(n, 1, LOST) for n in (1, 2, 3)],
            id="a cut link loses all and counts it",
        ),
        pytest.param(
            LinkDefect.DEAF,
            SENT,
            [
                WifiSent(1, 1, b"a"),
                *(StimulusDropped(n, 1, "a sound that a deaf modem did not hear") for n in (2, 3)),
            ],
            id="a deaf modem hears no sound, and the radio goes on",
        ),
    ],
)
def test_what_comes_back(
    defect: LinkDefect, sent: list[tuple[int, AgentStimulus]], came: list[Output]
) -> None:
    assert [it for _, it in heard({defect: 1.0}, sent, [])] == came


@settings(deadline=None, max_examples=20)
@given(st.lists(TIMES, max_size=5))
def test_a_healed_link_is_as_if_it_had_never_been_faulty(cuts: list[int]) -> None:
    states = {7: resting_on_bottom(1.0, 2.0, 3.0, 0.5, 1.0)}
    plain, faulty = InProcessHost(PAPER, states), FaultyHost(InProcessHost(PAPER, states), seed=1)
    lives = []
    for host in (plain, faulty):
        coordinator = Coordinator(host, {7: 0}, TimeScale(1))
        events = coordinator.advance(0)
        if isinstance(host, FaultyHost):
            host.set_defect(7, LinkDefect.DELAY, 50)
            host.heal(7, LinkDefect.DELAY)
            assert not host._defects
        for at_ms in [*sorted(cuts), END_MS]:
            events += coordinator.advance(at_ms)
        lives.append((events, host.take_truths()))
    assert lives[0] == lives[1]
