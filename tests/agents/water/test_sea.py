"""A fleet in its sea, with agents as objects: who receives what and when, ranges, and cuts of time that change nothing."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import pytest
from fleets import reporting_every
from hypothesis import given, settings
from hypothesis import strategies as st
from seas import FLEET, SEA, SeaBench

from agents.mussel.outputs import Output, Truth
from agents.mussel.stimuli import ContactClosed, SoundArrived
from agents.water.sea_events import (
    AgentRanged,
    SeaResult,
    SoundReached,
    StimulusDelivered,
    address_of,
)
from agents.water.wifi import Wifi
from firmware_model.packets import AcousticStatus, CommandPacket, Kind, ShortStatus
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.power.charge import FULL
from firmware_model.states import State
from firmware_model.table_one import MODEL

HOUR_MS = 3_600_000


class Bench(SeaBench):
    def state(self, agent_id: int) -> State:
        return self.host._agents[agent_id].board.state


def command(kind: Kind, agent_id: int) -> bytes:
    return MusselbedCodec().encode(CommandPacket(kind, agent_id))


def of(kind: type, results: list[SeaResult]) -> list[SeaResult]:
    return [it for it in results if isinstance(it, kind)]


def test_hourly_statuses_reach_the_aPad_in_their_slots() -> None:
    """Wake at the hour, 70 s of work, the next frame of 300 s: slot n opens at 3900 + 5 n s. 45 bytes last 868 ms.

    300 m are 200 ms and 150 m are 100 ms.
    """
    bench = Bench(300, 150)
    heard = of(SoundReached, bench.run(2 * HOUR_MS))
    assert [(it.mission_ms, it.agent_id) for it in heard if isinstance(it, SoundReached)] == [
        (3_901_068, 1),
        (3_905_968, 2),
    ]
    packets = [MusselbedCodec().decode(it.data) for it in heard if isinstance(it, SoundReached)]
    assert [(it.agent_id, it.agent_ms) for it in packets if isinstance(it, AcousticStatus)] == [
        (1, 3_900_000),
        (2, 3_905_000),
    ]


def test_a_permission_is_met_at_its_end_and_wakes_a_sleeper() -> None:
    bench = Bench(750)
    bench.run(100_000)
    assert bench.state(1) is State.SLEEPING
    bench.sea.send_sound(1, command(Kind.PERMISSION, 1))
    told = of(StimulusDelivered, bench.run(101_000))
    # 6 bytes last 105 + 22 * 12.5 = 380 ms, and are 500 ms under way.
    assert told == [StimulusDelivered(100_880, 1, 100_880, SoundArrived(command(Kind.PERMISSION, 1)))]
    bench.run(102_000)
    assert bench.state(1) is State.SURFACING


def test_a_sleeper_that_is_asked_answers_half_a_second_later_and_sleeps_on() -> None:
    """The question lasts 105 + 22 * 12.5 = 380 ms, the answer of 7 bytes 105 + 23 * 12.5 = 392.5; 100 ms under way."""
    bench = Bench(150)
    bench.run(100_000)
    bench.sea.send_sound(1, command(Kind.PING, 1))
    (reached,) = (it for it in bench.run(110_000) if isinstance(it, SoundReached))
    assert reached.mission_ms == 100_000 + 380 + 100 + 500 + 393 + 100
    answer = MusselbedCodec().decode(reached.data)
    assert isinstance(answer, ShortStatus) and (answer.agent_id, answer.state) == (1, State.SLEEPING)
    assert bench.state(1) is State.SLEEPING


def test_a_range_costs_the_battery_what_the_modem_draws_for_its_answer() -> None:
    """105 ms at 1500 mW instead of listening at 12.5, of a battery of 7400 mWh; and no board woke."""
    bench, other = Bench(240), Bench(240)
    bench.run(100_000)
    other.run(100_000)
    bench.sea.ping(1)
    (answered, left) = (it.host._agents[1].board for it in (bench, other))
    for it in (bench, other):
        it.run(110_000)
    charge = MODEL.charge_at(left.primary, 110_000) - MODEL.charge_at(answered.primary, 110_000)
    assert charge / FULL == pytest.approx((1500 - 12.5) * 0.105 / 3600 / 7400, rel=1e-6)
    assert answered.state is State.SLEEPING


def test_ranges_are_those_of_the_places_to_the_modems_step() -> None:
    """A step is 62.5 us of the round trip: 4.6875 cm. A ping and its answer are 105 ms each, and 160 ms under way."""
    bench = Bench(240, 33.3)
    bench.run(100_000)
    bench.sea.ping(1)
    bench.sea.ping(2)
    results = bench.run(110_000)
    ranges = [it for it in results if isinstance(it, AgentRanged)]
    assert [(it.agent_id, it.mission_ms) for it in ranges] == [(1, 100_530), (2, 100_786)]
    assert ranges[0].range_m == pytest.approx(240.0, abs=0.024)
    assert ranges[1].range_m == pytest.approx(33.3, abs=0.024)
    assert ranges[0].range_m / 0.046875 == pytest.approx(round(240 / 0.046875), abs=1e-9)


def test_range_noise_has_the_stated_spread() -> None:
    bench = Bench(240, sea=replace(SEA, sound=replace(SEA.sound, range_noise_m=0.5)))
    bench.run(100_000)
    for _ in range(200):
        bench.sea.ping(1)
    ranges = [it.range_m for it in bench.run(300_000) if isinstance(it, AgentRanged)]
    assert len(ranges) == 200
    mean = sum(ranges) / 200
    # Four standard errors: of the mean 0.5 / sqrt(200), of the deviation 0.5 / sqrt(400).
    assert mean == pytest.approx(240, abs=0.142)
    assert (sum((it - mean) ** 2 for it in ranges) / 199) ** 0.5 == pytest.approx(0.5, abs=0.1)


def test_wifi_reaches_as_far_as_its_model_says() -> None:
    """20 + 85 dB are 49 dB too few at 2 km, and 30 too many at 20 m."""

    def heard_of(docks: Bench) -> Counter[int]:
        docks.run(100_000)
        for agent_id in (1, 2):
            docks.sea.send_sound(agent_id, command(Kind.PERMISSION, agent_id))
        return Counter(it.agent_id for it in docks.run(2 * HOUR_MS) if isinstance(it, Output))

    docks = Bench(20, 2000, sea=replace(SEA, wifi=Wifi()))
    everything = heard_of(Bench(20, 2000))  # without Wi-Fi's model all of it arrives
    assert set(everything) == {1, 2}
    assert heard_of(docks) == {1: everything[1]}
    assert docks.sea.dropped["Wi-Fi: lost in the air"] == everything[2]
    assert docks.sea.wifi_reaches(1, 2 * HOUR_MS) and not docks.sea.wifi_reaches(2, 2 * HOUR_MS)


def test_addresses_have_eight_bits() -> None:
    addresses = [address_of(node) for node in range(1000)]
    assert addresses[0] == 255 and set(addresses[1:255]) == set(range(1, 255))
    assert addresses[255] == addresses[1]


words = st.lists(
    st.tuples(
        st.integers(0, 20), st.integers(1, 3), st.sampled_from(["ping", "permission", "range", "dock"])
    ),
    max_size=10,
)


def played(
    asked: list[tuple[int, int, str]], cuts_ms: list[int]
) -> tuple[list[SeaResult], dict[int, list[Truth]]]:
    """An hour and a bit of agent time at theta 60; the aPad sends packets at whole seconds of mission time."""
    drifting = replace(FLEET.body, drifts_always=True, drift_amplitude_um=50_000)
    fleet = reporting_every(replace(FLEET, theta=60, body=drifting), 60_000)
    bench = Bench(
        100, 220, 410, sea=replace(SEA, wifi=Wifi(), sound=replace(SEA.sound, range_noise_m=0.1)), fleet=fleet
    )
    truths: list[Truth] = []
    for now_ms in sorted({*range(0, 70_000, 1000), *cuts_ms}):
        bench.came += bench.sea.advance(now_ms)
        truths += bench.sea.take_truths()
        for at, agent_id, what in asked if now_ms % 1000 == 0 else ():
            if at != now_ms // 1000:
                continue
            if what == "range":
                bench.sea.ping(agent_id)
            elif what == "dock":
                bench.coordinator.receive(agent_id, ContactClosed(1, 2), now_ms)
            else:
                bench.sea.send_sound(agent_id, command(Kind[what.upper()], agent_id))
    told: dict[int, list[Truth]] = {}
    for truth in truths:
        told.setdefault(truth.agent_id, []).append(truth)
    return bench.came, told


@settings(max_examples=25, deadline=None)
@given(words, st.lists(st.integers(0, 69_000), max_size=6))
def test_cutting_time_changes_nothing(asked: list[tuple[int, int, str]], cuts_ms: list[int]) -> None:
    whole, cut = played(asked, []), played(asked, cuts_ms)
    assert cut[1] == whole[1]
    assert sorted(map(repr, cut[0])) == sorted(map(repr, whole[0]))
