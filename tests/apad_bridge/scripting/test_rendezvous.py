"""Tests the turns: a tick waits for the script, a script that never calls back stops nothing, and each side learns of the
other's end.
"""

import threading
import time

import pytest

from apad_bridge.events.run_events import EndReason
from apad_bridge.runs.script_in_memory import fly_script
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scripting.api import Api
from apad_bridge.scripting.rendezvous import Aborted, Do, Rendezvous, ScriptFinished, TurnTimeouts, Wait
from tests.apad_bridge.scripting.test_api import flies

PATIENT = TurnTimeouts(tick_s=20.0, busy_s=20.0)


def test_what_is_asked_is_done_by_the_supervisor_s_thread() -> None:
    rendezvous, threads, answers = Rendezvous(PATIENT), [], []

    def script() -> None:
        answers.append(rendezvous.request(Do(lambda: threads.append(threading.current_thread()) or 7)))
        try:
            rendezvous.request(Do(lambda: None))
        except KeyError as error:
            answers.append(str(error))
        rendezvous.finish(None)

    thread = threading.Thread(target=script)
    rendezvous.begin()
    thread.start()
    request = rendezvous.next()
    assert isinstance(request, Do)
    rendezvous.answer(request.act())
    assert isinstance(rendezvous.next(), Do)
    rendezvous.answer(KeyError("raised there"))
    assert rendezvous.next() == ScriptFinished(None)
    thread.join(60)
    assert (threads, answers) == ([threading.current_thread()], [7, "'raised there'"])


def test_a_script_that_waits_when_the_mission_ends_is_aborted() -> None:
    rendezvous, ends = Rendezvous(PATIENT), []

    def script() -> None:
        for request in (Wait(None, 1000), Do(lambda: None)):
            try:
                rendezvous.request(request)
            except Aborted as aborted:
                ends.append(str(aborted))

    thread = threading.Thread(target=script)
    rendezvous.begin()
    thread.start()
    assert rendezvous.next() == Wait(None, 1000)
    rendezvous.close("enough")
    thread.join(60)
    assert ends == ["enough", "enough"]


def test_a_thread_that_a_script_starts_cannot_take_its_turn(pool: Scenario) -> None:
    errors: list[str] = []

    def helper(api: Api) -> None:
        with pytest.raises(RuntimeError) as refused:
            api.now()
        errors.append(str(refused.value))

    def script(api: Api) -> None:
        api.sleep(1)
        thread = threading.Thread(target=helper, args=(api,))
        thread.start()
        thread.join(60)
        api.sleep(1)

    flies(pool, script)
    assert errors == ["the API is for the script's own thread: let other threads pass their results to it"]


def test_a_condition_may_look_but_not_wait(pool: Scenario) -> None:
    """One that waits fails the script, and not the flight."""
    rendezvous = Rendezvous(PATIENT)
    rendezvous.begin()
    assert rendezvous.request(Do(lambda: 5)) == 5
    flight = fly_script(pool, lambda api: api.wait_until(lambda: api.sleep(1) is None, 5))
    assert "neither sleep nor wait" in flight.ended_by


def test_a_script_that_never_comes_back_ends_the_mission_not_the_machine(
    pool: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("apad_bridge.scripting.program._JOIN_S", 0.1)
    computes, released = threading.Event(), threading.Event()
    original_next = Rendezvous.next

    def patient(rendezvous: Rendezvous) -> object:
        # A thread that waits for a processor does not compute yet: this waits until it does, for a minute at most.
        until_s = time.monotonic() + 60.0
        while (
            (found := original_next(rendezvous)) is None
            and not computes.is_set()
            and time.monotonic() < until_s
        ):
            pass
        return found

    def script(api: Api) -> None:
        api.sleep(3)
        computes.set()
        released.wait(60)

    monkeypatch.setattr(Rendezvous, "next", patient)
    flight = fly_script(pool, script, TurnTimeouts(tick_s=0.05, busy_s=0.05))
    released.set()
    assert flight.ended_by == f"{EndReason.SCRIPT_FAILED}: it neither called the API nor slept for 0.05 s"
    # Virtual time ran on only until the script was judged stuck.
    assert flight.mission_s == pytest.approx(3, abs=2)


def test_in_real_time_ticks_go_on_while_a_script_computes(
    pool: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    computes, ticks = threading.Event(), threading.Semaphore(0)
    seen: list[float] = []

    def script(api: Api) -> None:
        before = api.now()
        # It computes until three ticks have passed without it; those before it began do not count.
        computes.set()
        for _ in range(3):
            assert ticks.acquire(timeout=30)
        seen.append(api.now() - before)

    original_next = Rendezvous.next

    def counted(rendezvous: Rendezvous) -> object:
        found = original_next(rendezvous)
        if found is None and computes.is_set():
            ticks.release()
        return found

    monkeypatch.setattr(Rendezvous, "next", counted)
    flight = fly_script(pool, script, TurnTimeouts(tick_s=0.01, busy_s=60.0))
    assert flight.error is None and seen[0] >= 2
