"""One sea for flights that are elsewhere: the same as beside it, whoever comes late, falls silent or is gone."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import example, given, settings
from shared_seas import ASKED, DISTURBED, NORTHS_M, THETA, Asked, Flown, act, drifting, played

from agents.time_scale import TimeScale
from agents.water import sea_link
from agents.water.sea import Sea
from agents.water.sea_client import RemoteSea, SeaRefused
from agents.water.sea_events import LeftWater, SeaLost, SoundReached
from agents.water.sea_link import LinkEnded
from agents.water.sea_server import SILENT_S, START_S, SeaServer

NAMES = ("apad1", "apad2")
PLACES_M = (0.0, 500.0)
PATIENCE_S = 60.0


class Served:
    """A served sea for two flights, whose clock a test can set."""

    def __init__(self, directory: str) -> None:
        self.directory = directory
        self.now_s = 0.0
        self.sea = Sea(DISTURBED, TimeScale(THETA), (1, 2, 3, 4), 2)
        self.server = SeaServer(self.sea, NAMES, sea_link.listen(directory), lambda: self.now_s)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        while not self._ended.is_set():
            self.server.step(0.01)

    def come(self, number: int, epoch: int = 1) -> RemoteSea:
        return RemoteSea.at(self.directory, number, NAMES[number], epoch, DISTURBED)

    def begun(self, number: int, epoch: int = 1) -> Flown:
        remote = self.come(number, epoch)
        flown = drifting(remote, number, PLACES_M[number])
        remote.begin(tuple(NORTHS_M[number]), 0)
        return flown

    def end(self) -> None:
        """As the end of its process: every link ends."""
        self._ended.set()
        self._thread.join()
        self.server.listener.close()
        for flight in self.server._flights:
            if flight.link is not None:
                flight.link.close()


@contextmanager
def served() -> Iterator[Served]:
    with TemporaryDirectory() as directory:
        one = Served(directory)
        try:
            yield one
        finally:
            one.end()


@contextmanager
def in_threads() -> Iterator[Callable[[Callable[[], Flown]], Future[Flown]]]:
    with ThreadPoolExecutor(2) as threads:
        yield threads.submit


def flown_from(
    sea: Served, number: int, asked: Asked, until_ms: int = 70_000, *, leaves: bool = True
) -> Flown:
    flown = sea.begun(number)
    for now_ms in range(0, until_ms, 1000):
        act(flown, asked, PLACES_M[number], now_ms)
    if leaves:
        flown.station.leave()
    return flown


def both(sea: Served, fly: Callable[[int], Flown]) -> tuple[Flown, Flown]:
    with in_threads() as start:
        first, second = start(lambda: fly(0)), start(lambda: fly(1))
        return first.result(PATIENCE_S), second.result(PATIENCE_S)


SOUNDING: Asked = [(2, 1, "ping"), (2, 2, "permission"), (7, 3, "range"), (9, 1, "wifi"), (13, 4, "ping")]


@settings(max_examples=4, deadline=None)
@given(ASKED)
@example(SOUNDING)
def test_flights_elsewhere_see_the_same_as_beside_the_sea(asked: Asked) -> None:
    """Every result in its order, every truth, every count, and each packet of Wi-Fi."""
    beside = played(Sea(DISTURBED, TimeScale(THETA), (1, 2, 3, 4), 2), asked, PLACES_M, (0, 1))
    with served() as sea:
        elsewhere = both(sea, lambda number: flown_from(sea, number, asked))
    for one, other in zip(beside, elsewhere, strict=True):
        assert (one.came, one.truths, one.reached) == (other.came, other.truths, other.reached)
        assert one.station.all_dropped == other.station.all_dropped
    if asked == SOUNDING:
        assert all(it.of(SoundReached) for it in beside) and beside[0].reached


def test_they_begin_together_on_the_latest_clock() -> None:
    with served() as sea, in_threads() as start:
        remotes = [sea.come(number) for number in (0, 1)]
        for number, remote in enumerate(remotes):
            drifting(remote, number, PLACES_M[number])
        begins = [
            start(lambda remote=remote, clock_ms=clock_ms: remote.begin((), clock_ms))  # type: ignore[misc]
            for remote, clock_ms in zip(remotes, (5_000, 7_400), strict=True)
        ]
        assert {(it.result(PATIENCE_S).now_ms, it.result(PATIENCE_S).clock_ms) for it in begins} == {
            (None, 7_400)
        }


def test_one_that_is_gone_before_it_begins_is_not_waited_for() -> None:
    with served() as sea, in_threads() as start:
        gone = sea.come(1)
        alone = start(lambda: flown_from(sea, 0, [], 3_000))
        assert not alone.done()
        gone._link.close()
        assert alone.result(PATIENCE_S).of(SeaLost) == []


def test_one_that_never_comes_is_waited_for_as_long_as_stated() -> None:
    with served() as sea, in_threads() as start:
        alone = start(lambda: flown_from(sea, 0, [], 3_000))
        _wait_until(lambda: sea.server._waits_since_s is not None)
        sea.now_s = START_S
        assert alone.result(PATIENCE_S).of(SeaLost) == []


def test_one_that_falls_silent_is_out_of_the_water_and_both_go_on() -> None:
    with served() as sea:
        first, second = both(sea, lambda number: flown_from(sea, number, [], 3_000, leaves=False))
        with in_threads() as start:
            going_on = start(lambda: _fly(first, 3_000))
            _wait_until(lambda: sea.server._waits_since_s is not None)
            sea.now_s += SILENT_S
            going_on.result(PATIENCE_S)
        why = f"silent for {SILENT_S:g} s"
        assert first.of(LeftWater) == [LeftWater(2_000, "apad2", why)]
        # It goes on without water when it comes again: its fleet lives, and its modem is deaf.
        second.station.ping(2)
        _fly(second, 3_000, 70_000)
        assert second.of(LeftWater) == [LeftWater(3_000, "apad2", why)]
        assert max(it.at_ms for it in second.truths) > 60 * 3_000
        assert not [it for it in second.of(SoundReached) if it.mission_ms > 3_000]  # type: ignore[attr-defined]
        assert {type(it).__name__: it.agent_id for it in second.came if type(it).__name__ == "NotRanged"} == {  # type: ignore[union-attr]
            "NotRanged": 2
        }
        assert second.station.all_dropped["sound: its aPad is not in the water any more"] > 0
        _fly(first, 4_000)


def test_a_killed_one_finds_its_station_again_at_the_time_of_the_others() -> None:
    with served() as sea:
        first, second = both(sea, lambda number: flown_from(sea, number, [], 3_000, leaves=False))
        second.station._link.close()  # type: ignore[union-attr]
        _fly(first, 3_000, 9_000)
        assert [it.name for it in first.of(LeftWater)] == ["apad2"]  # type: ignore[attr-defined]
        with pytest.raises(SeaRefused, match="a newer supervisor of apad2"):
            sea.come(1, epoch=1)
        with in_threads() as start:
            remote = sea.come(1, epoch=2)
            assert remote.now_ms == 8_000
            again = drifting(remote, 1, PLACES_M[1])
            assert remote.begin(tuple(NORTHS_M[1]), 99).now_ms == 8_000
            both_go_on = [start(lambda it=it: _fly(it, 9_000, 70_000)) for it in (first, again)]  # type: ignore[misc]
            for it in both_go_on:
                it.result(PATIENCE_S)
        heard = {it.agent_id for it in first.of(SoundReached)}  # type: ignore[attr-defined]
        assert heard & {2, 4} and {it.agent_id for it in again.of(SoundReached)} & {1, 3}  # type: ignore[attr-defined]


def test_a_sea_that_is_gone_is_told_to_each_flight_and_their_fleets_live_on() -> None:
    with served() as sea:
        flights = both(sea, lambda number: flown_from(sea, number, [], 3_000, leaves=False))
        sea.end()
        for flown in flights:
            results = flown.advance(3_000)
            assert [type(it) for it in results if isinstance(it, SeaLost)] == [SeaLost]
            _fly(flown, 4_000, 10_000)
            assert max(it.at_ms for it in flown.truths) > 60 * 4_000
        with pytest.raises(SeaRefused):
            sea.come(0, epoch=2)


def test_a_link_takes_messages_alone(tmp_path: Path) -> None:
    import os
    import pickle

    class Harm:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return os.mkdir, (str(tmp_path / "harm"),)

    with ExitStack() as stack:
        listener = stack.enter_context(sea_link.listen(str(tmp_path)))
        ours = sea_link.connect(str(tmp_path), 5.0)
        stack.callback(ours.close)
        sock, _ = listener.accept()
        theirs = sea_link.Link(sock)
        stack.callback(theirs.close)
        for data in (b"", b"\x80", pickle.dumps(Harm()), pickle.dumps(3), pickle.dumps(os.mkdir)):
            ours._connection.send_bytes(data)
            with pytest.raises(LinkEnded, match="not a message"):
                theirs.receive(5.0)
    assert not (tmp_path / "harm").exists()


def _fly(flown: Flown, from_ms: int, until_ms: int = 0) -> Flown:
    """From a tick to another one, or that tick alone."""
    for now_ms in range(from_ms, until_ms or from_ms + 1, 1000):
        flown.advance(now_ms)
    return flown


def _wait_until(what: Callable[[], bool]) -> None:
    pause = threading.Event()
    for _ in range(int(PATIENCE_S / 0.01)):
        if what():
            return
        pause.wait(0.01)
    raise AssertionError("it did not come")
