"""Killed anywhere, an aPad goes on with the ways, ranges and turns that it had: by a checkpoint and what came since."""

from __future__ import annotations

import json
from math import dist

from hypothesis import given, settings
from hypothesis import strategies as st

from apad_bridge.acoustics.locator import Locator, LocatorConfig
from apad_bridge.acoustics.ranging import RangingService
from apad_bridge.acoustics.schedule import AcousticScheduler, ScheduleConfig
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.hold_last import HoldLast
from apad_bridge.mission.events import RangeHeard
from apad_bridge.vehicle.commands import PoseReported
from firmware_model.config import Slots
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
    slots = Slots(frame_ms=60_000, slot_ms=2000, guard_ms=100)
    config = ScheduleConfig(
        2,
        1500.0,
        100,
        waits=True,
        assigns=True,
        guard_ms=100,
        beacon_period_ms=900_000,
        ping_period_ms=30_000,
    )
    locator = Locator(LocatorConfig(0.2, 10.0, 600.0, 5.0))
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
    known = HoldLast(IDS)
    for agent_id, (north_m, east_m, _) in MUSSELS_M.items():
        known.hear(StatusPacket(agent_id, 0, State.SLEEPING, 0.9, 1.0, north_m + 1, east_m, 10.0, 0), 0)
    return known


WHERE = st.tuples(st.sampled_from((0.0, 20.0, 60.0)), st.sampled_from((0.0, 40.0, 80.0)))
TICKS = st.lists(
    st.tuples(
        st.sampled_from((1000, 10_000, 400_000)),
        st.sampled_from(IDS),
        st.one_of(st.just("nothing"), st.just("moved"), WHERE),
    ),
    max_size=25,
)


def tick(it: RangingService, known: HoldLast, now_ms: int, agent_id: int, what: object) -> list[object]:
    said: list[object] = []
    if what == "moved":
        it.moved(agent_id, now_ms)
    elif isinstance(what, tuple):
        north_m, east_m = what
        fact = RangeHeard(now_ms, agent_id, dist((north_m, east_m, KEEL_M), MUSSELS_M[agent_id]))
        said += it.hear(fact, PoseReported(now_ms, north_m, east_m, 0.0), known, now_ms)
    return [*said, *it.advance(known.all(), now_ms)]


@settings(deadline=None, max_examples=60)
@given(ticks=TICKS, checkpoint_after=st.integers(0, 25))
def test_a_checkpoint_and_the_news_since_are_all_that_was_learned(
    ticks: list[tuple[int, int, object]], checkpoint_after: int
) -> None:
    killed, known = ranging(), beliefs()
    checkpoint, news, now_ms = json.dumps(killed.kept()), list[str](), 0
    for n, (after_ms, agent_id, what) in enumerate(ticks):
        now_ms += after_ms
        tick(killed, known, now_ms, agent_id, what)
        if n == checkpoint_after:
            checkpoint, news = json.dumps(killed.kept()), []
        elif (came := killed.news()) is not None:
            news.append(json.dumps(came))

    resumed = ranging()
    resumed.restore(json.loads(checkpoint))
    for line in news:
        resumed.take_news(json.loads(line))
    assert killed.news() is None
    assert json.dumps(resumed.kept()) == json.dumps(killed.kept())
    # Half an hour later the air is free again for both. What the dead one had asked is awaited by nobody else.
    now_ms += 1_800_000
    for agent_id in IDS:
        said = [tick(it, beliefs(), now_ms, agent_id, (60.0, 0.0)) for it in (killed, resumed)]
        assert [word for word in said[0] if getattr(word, "kind", None) != "unanswered"] == said[1]


def test_who_has_learned_nothing_new_tells_nothing() -> None:
    it = ranging()
    assert it.news() is None
    it.advance(beliefs().all(), 0)
    assert it.news() is not None
    assert it.news() is None
