"""Tests that a killed aPad goes on with its delays, ranges and ping order, from a full state and the updates after it."""

from __future__ import annotations

import json
from math import dist

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.time_scale import TimeScale
from apad_bridge.acoustics.locator import Locator
from apad_bridge.acoustics.ranging import RangingService
from apad_bridge.acoustics.schedule import AcousticScheduler, ScheduleConfig
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.hold_last import HoldLast
from apad_bridge.mission.facts import RangeHeard
from apad_bridge.scenario.water.water_options import Localisation, Talk, Water
from apad_bridge.vehicle.commands import PoseReported
from firmware_model.config import Timeslots
from firmware_model.packets import StatusPacket
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.states import State

IDS = (7, 8)
MUSSELS_M = {7: (30.0, 40.0, 10.0), 8: (5.0, 20.0, 10.0)}
KEEL_M = 0.5


class Always:
    def is_worth(self, belief: Belief, now_ms: int) -> bool:
        return True

    def urgency(self, belief: Belief) -> float:
        return float(belief.agent_id)


def ranging() -> RangingService:
    slots = Timeslots(frame_ms=60_000, slot_ms=2000, guard_ms=100)
    talk = Talk(assigns=True, beacon_period_s=900.0, ping_period_s=30.0)
    config = ScheduleConfig(TimeScale(2), Water(talk=talk), 100)
    locator = Locator(Localisation(deviation_m=0.2, memory_s=600.0, apart_m=5.0), 10.0)
    return RangingService(
        AcousticScheduler(config, MusselbedCodec(), slots, IDS),
        locator,
        KEEL_M,
        10.0,
        0.2,
        Always(),
        Always(),
    )


def beliefs() -> HoldLast:
    fleet = HoldLast(IDS)
    for agent_id, (north_m, east_m, _) in MUSSELS_M.items():
        fleet.hear(StatusPacket(agent_id, 0, State.SLEEPING, 0.9, 1.0, north_m + 1, east_m, 10.0, 0), 0)
    return fleet


WHERE = st.tuples(st.sampled_from((0.0, 20.0, 60.0)), st.sampled_from((0.0, 40.0, 80.0)))
TICKS = st.lists(
    st.tuples(
        st.sampled_from((1000, 10_000, 400_000)),
        st.sampled_from(IDS),
        st.one_of(st.just("nothing"), st.just("moved"), WHERE),
    ),
    max_size=25,
)


def tick(it: RangingService, fleet: HoldLast, now_ms: int, agent_id: int, what: object) -> list[object]:
    heard: list[object] = []
    if what == "moved":
        it.moved(agent_id, now_ms)
    elif isinstance(what, tuple):
        fact = RangeHeard(now_ms, agent_id, dist((*what, KEEL_M), MUSSELS_M[agent_id]))
        heard = [*it.hear(fact, PoseReported(now_ms, *what, 0.0), fleet, now_ms)]
    return [*heard, *it.advance(fleet.all(), now_ms)]


@settings(deadline=None, max_examples=60)
@given(ticks=TICKS, checkpoint_after=st.integers(0, 25))
def test_a_full_state_and_the_updates_since_are_all_that_was_learned(
    ticks: list[tuple[int, int, object]], checkpoint_after: int
) -> None:
    killed, fleet = ranging(), beliefs()
    checkpoint, updates, now_ms = json.dumps(killed.full_state()), list[str](), 0
    for n, (after_ms, agent_id, what) in enumerate(ticks):
        now_ms += after_ms
        tick(killed, fleet, now_ms, agent_id, what)
        if n == checkpoint_after:
            checkpoint, updates = json.dumps(killed.full_state()), []
        elif (update := killed.updates()) is not None:
            updates.append(json.dumps(update))

    resumed = ranging()
    resumed.restore(json.loads(checkpoint))
    for line in updates:
        resumed.apply_updates(json.loads(line))
    assert killed.updates() is None
    assert json.dumps(resumed.full_state()) == json.dumps(killed.full_state())
    # Half an hour later nothing is scheduled in either. Only the dead one still awaits its answers.
    now_ms += 1_800_000
    for agent_id in IDS:
        of_killed, of_resumed = (
            tick(it, beliefs(), now_ms, agent_id, (60.0, 0.0)) for it in (killed, resumed)
        )
        assert [it for it in of_killed if getattr(it, "kind", None) != "unanswered"] == of_resumed


def test_without_anything_new_there_are_no_updates() -> None:
    it = ranging()
    assert it.updates() is None
    it.advance(beliefs().all(), 0)
    assert it.updates() is not None and it.updates() is None


@pytest.mark.parametrize("row", [[], [7], ["moved"], ["range", 1, 2], [1000, 7, 5.0, 1.0, 2.0, 3.0]])
def test_a_row_of_no_known_kind_is_refused(row: list[object]) -> None:
    it = ranging()
    state = it.full_state()
    with pytest.raises((IndexError, KeyError, TypeError)):
        it.apply_updates({"talk": state["talk"], "rows": [row]})
