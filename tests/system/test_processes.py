"""A process per aMussel, with real processes: the same trace as one process, and what dies alone dies alone."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from itertools import accumulate
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from fleets import KILL, PAPER, Story, command, deaths, fly, heard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from killing import gone, kill_9, standing_still
from patient import PATIENCE_S
from programs import processes_of

from agents.coordinator import Coordinator
from agents.fleet_config import resting_on_bottom
from agents.hosting.host import Grant, Host, Reply
from agents.hosting.in_process import InProcessHost
from agents.hosting.link_protocol import LIMIT_BYTES, WindowGrant, readable
from agents.hosting.process_host import Fenced, ProcessHost
from agents.mussel.outputs import Truth, WifiSent
from agents.mussel.stimuli import ContactClosed, ContactOpened, DockMoved
from agents.nursery import protocol
from agents.nursery.fleet_file import PHYSICAL_NAME, RestartPolicy
from agents.nursery.launch import NurseryFailed, StartedNursery, launch_nursery, prepare
from agents.nursery.state_file import RING_BYTES
from agents.time_scale import TimeScale
from firmware_model.packets import Kind
from firmware_model.power.charge import Flow
from firmware_model.states import State
from firmware_model.stimuli import ResetCause

pytestmark = pytest.mark.system

IDS = (3, 8, 21)
THETA = 30
FLEET = PAPER
BIRTHS = {agent_id: resting_on_bottom(0.0, agent_id, 3.0, 0.3, 1.0) for agent_id in IDS}
PATIENT = RestartPolicy(restarts=1000)


def coordinator(host: Host) -> Coordinator:
    return Coordinator(host, dict.fromkeys(IDS, 0), TimeScale(THETA))


def started(folder: Path, policy: RestartPolicy = PATIENT, **options: Any) -> ProcessHost:
    """With a watchdog that lets a busy machine take its time."""
    options = {"window_timeout_s": PATIENCE_S, "restart_policy": policy} | options
    return ProcessHost.start(folder, FLEET, BIRTHS, **options)


@pytest.fixture
def host(tmp_path: Path) -> Iterator[ProcessHost]:
    with closing(started(tmp_path)) as host:
        yield host
    assert gone(host.nursery_pid)


EVENTS = st.one_of(
    st.just(KILL),
    st.sampled_from([ContactClosed(1, 2), DockMoved(9, 9), ContactOpened()]),
    st.sampled_from(
        [command(kind, agent_id) for kind in (Kind.PERMISSION, Kind.RELEASE) for agent_id in IDS]
    ),
)
STORIES = st.lists(st.tuples(st.integers(0, 20), st.sampled_from(IDS), EVENTS), max_size=12)


STEPS_MS = st.lists(st.integers(1, 4000), min_size=5, max_size=20) | st.lists(
    st.sampled_from([1000, 1000, 1000, 1000, 2000, 700]), min_size=20, max_size=60
)


@pytest.mark.parametrize("looks_ahead", [False, True])
@settings(max_examples=14, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(story=STORIES, steps_ms=STEPS_MS)
def test_one_process_and_many_give_the_same_trace(
    tmp_path_factory: pytest.TempPathFactory, looks_ahead: bool, story: Story, steps_ms: list[int]
) -> None:
    """Of an agent that runs ahead, a kill is noticed as soon as its windows are used up: the death's time says when."""
    with closing(started(tmp_path_factory.mktemp("run"), looks_ahead=looks_ahead)) as many:
        # A death at 0 ms of one that runs ahead may be of the first window or of the second.
        story = [entry for entry in story if entry[0] > 0 or not looks_ahead]
        came, told = fly(many, IDS, story, steps_ms)
        assert not many.dropped
    if looks_ahead:
        ends_ms = [THETA * end_ms for end_ms in accumulate(steps_ms, initial=0)]
        noticed: Story = [
            (next(step for step, end_ms in enumerate(ends_ms) if end_ms > it.agent_ms), it.agent_id, KILL)
            for it in deaths(came)
        ]
        story = [*noticed, *(entry for entry in story if entry[2] != KILL)]
    assert (came, told) == fly(InProcessHost(FLEET, BIRTHS), IDS, story, steps_ms)


def test_few_messages_pass_while_nothing_happens(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with closing(started(tmp_path, looks_ahead=True)) as ahead:
        asked: list[dict[int, bytes]] = []
        ask = ahead.links.ask
        monkeypatch.setattr(ahead.links, "ask", lambda key, frames: asked.append(frames) or ask(key, frames))
        clock = coordinator(ahead)
        assert len(heard(it for now_s in range(101) for it in clock.advance(1000 * now_s))) == 3 * 100
        assert len(asked) == 1


def last_truths(truths: list[Truth]) -> dict[int, Truth]:
    return {truth.agent_id: truth for truth in truths}


def test_kill_9_of_an_agent_in_mid_charge_and_then_of_the_nursery_boots_and_charges_on(
    host: ProcessHost,
) -> None:
    """aMussel 8 is in a dock, charging at 10 s of mission time. Agents end with their nursery."""
    clock = coordinator(host)
    clock.receive(8, command(Kind.PERMISSION, 8), 1_000)
    clock.advance(1_000)
    clock.receive(8, ContactClosed(7_000_000, 8_000_000), 5_000)
    clock.advance(10_000)
    before, old_pid = last_truths(host.take_truths())[8], host.pids[8]
    assert before.state is State.CHARGING
    kill_9(old_pid)
    died = deaths(clock.advance(20_000))
    assert [(it.agent_id, it.agent_ms, it.cause, it.reason, it.gave_up) for it in died] == [
        (8, 300_000, ResetCause.BROWN_OUT, "killed by SIGKILL", None)
    ]
    truths = host.take_truths()
    mine = [truth for truth in truths if truth.agent_id == 8]
    assert [(it.at_ms, it.state) for it in mine] == [(300_000, State.BOOTING), (302_000, State.CHARGING)]
    # Its battery's anchor and its place went on.
    assert all(truth.physical == before.physical for truth in mine)
    assert mine[-1].physical.primary.flow is Flow.CHARGING
    assert host.pids[8] != old_pid and gone(old_pid)

    kept, first = last_truths(truths), host.nursery_pid
    kill_nursery(host)
    died = deaths(clock.advance(21_000))
    assert [(it.agent_id, it.reason) for it in died] == [(it, "its nursery died") for it in IDS]
    assert host.nursery_pid != first and set(host.pids) == set(IDS)
    booted = {it.agent_id: it for it in host.take_truths() if it.state is State.BOOTING}
    assert {it.at_ms for it in booted.values()} == {600_000} and booted.keys() == set(IDS)
    assert all(booted[it].physical == truth.physical for it, truth in kept.items())


def kill_nursery(host: ProcessHost) -> None:
    """Its agents end with it."""
    pids = list(host.pids.values())
    kill_9(host.nursery_pid)
    assert all(gone(pid) for pid in pids)


def test_a_nursery_starts_no_stranger_nobody_twice_and_obeys_no_guest(
    host: ProcessHost, tmp_path: Path
) -> None:
    """Nor do bad messages, to an agent or to the nursery, disturb anything."""
    reference = InProcessHost(FLEET, BIRTHS)
    mine, theirs = coordinator(host), coordinator(reference)
    assert mine.advance(1_000) == theirs.advance(1_000)
    host.links.link(3).send(b"\xc1garbage")
    with protocol.connect(str(tmp_path), 5.0) as guest:
        for data in (b"\xc1garbage", bytes(LIMIT_BYTES + 1), protocol.encode(protocol.End())):
            guest.send(data)
            answer = protocol.receive(guest)
            assert answer is not None and isinstance(answer[0], protocol.StartRefused)
    assert host.restart(99, 0, ResetCause.BROWN_OUT) == "aMussel 99 is not of this fleet"
    assert host.restart(8, 0, ResetCause.BROWN_OUT) == f"aMussel 8 lives already, as process {host.pids[8]}"
    with pytest.raises(NurseryFailed, match="another nursery"):
        launch_nursery(tmp_path)
    assert mine.advance(5_000) == theirs.advance(5_000) and host.take_truths() == reference.take_truths()
    assert [it.partition(": ")[0] for it in host.dropped] == ["refused"]


def test_an_id_that_cannot_be(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="aMussel 65536: ids are 0 to 65535"):
        ProcessHost.start(tmp_path, FLEET, {65536: BIRTHS[3]})


def test_a_nursery_that_nobody_waits_for_any_more_is_ended_and_one_that_was_waited_for_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare(tmp_path, FLEET, BIRTHS)

    def interrupted(reading: int, timeout_s: float) -> bool:
        # Not before it speaks: for a moment after it was begun, a process has no command line to be known by.
        assert readable(reading, timeout_s) and processes_of(tmp_path)
        raise KeyboardInterrupt

    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr("agents.nursery.launch.readable", interrupted)
        launch_nursery(tmp_path)
    StartedNursery(tmp_path).end()
    assert not processes_of(tmp_path)
    waited_for = StartedNursery(tmp_path)
    process = waited_for.ready()
    waited_for.end()
    assert process.poll() is None
    process.kill()
    process.wait()


@pytest.mark.parametrize(("settled_s", "kills"), [(600.0, 3), (RestartPolicy().settled_s, 5)])
def test_an_agent_that_dies_at_once_again_and_again_stays_dead_and_one_that_lived_in_between_does_not(
    tmp_path: Path, settled_s: float, kills: int
) -> None:
    """Killed in each tick, which is 30 s of its time, boots included."""
    with closing(started(tmp_path, RestartPolicy(restarts=2, settled_s=settled_s))) as host:
        clock = coordinator(host)
        gave_up: list[str | None] = []
        for second in range(1, kills + 1):
            kill_9(host.pids[3])
            gave_up += [it.gave_up for it in deaths(clock.advance(second * 1_000))]
        assert gave_up[:-1] == [None] * (kills - 1)
        stays = (
            "aMussel 3 was restarted 2 times in a row and lived for less than 600 s of its time after each boot: "
            "it stays dead"
        )
        assert gave_up[-1] == (stays if settled_s == 600 else None)
        assert clock.agent_ids == heard(clock.advance(1_000 * (kills + 1)))
        assert clock.agent_ids == ([8, 21] if gave_up[-1] else [3, 8, 21])


@pytest.mark.parametrize("written", [b"kept" * 1024 * len(IDS), b"kept" * (RING_BYTES // 2 * len(IDS))])
def test_a_fleet_whose_states_another_version_wrote_is_not_born_anew(tmp_path: Path, written: bytes) -> None:
    prepare(tmp_path, FLEET, BIRTHS)
    (tmp_path / PHYSICAL_NAME).write_bytes(written)
    with pytest.raises(NurseryFailed, match="another version of musselbed wrote it"):
        launch_nursery(tmp_path)
    assert (tmp_path / PHYSICAL_NAME).read_bytes() == written


def test_a_nursery_that_died_while_it_wrote_the_first_states_leaves_a_fleet_that_can_begin(
    tmp_path: Path,
) -> None:
    prepare(tmp_path, FLEET, BIRTHS)
    (tmp_path / PHYSICAL_NAME).write_bytes(bytes(RING_BYTES + 150))  # the second aMussel's record is the last
    with launch_nursery(tmp_path) as nursery:
        with closing(ProcessHost.adopt(tmp_path, 1)) as host:
            assert list(host.granted_ms) == list(IDS)
        assert nursery.wait(PATIENCE_S) == 0


SUPERVISOR = """
import sys
from agents.coordinator import Coordinator
from agents.time_scale import TimeScale
from agents.hosting.process_host import ProcessHost
print("ready", flush=True)
sys.stdin.readline()
host = ProcessHost.adopt(sys.argv[1], 1)
clock = Coordinator(host, host.granted_ms, TimeScale(30))
for second in range(1, 11):
    clock.advance(second * 1000)
print(*host.pids.values(), flush=True)
sys.stdin.read()
"""


def orphaned(run_dir: Path, restart_policy: RestartPolicy) -> tuple[subprocess.Popen[bytes], list[int]]:
    """A nursery whose supervisor was killed at 10 s of mission time, and its agents' processes."""
    prepare(run_dir, FLEET, BIRTHS, restart_policy)
    supervisor = subprocess.Popen(
        [sys.executable, "-c", SUPERVISOR, run_dir], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    with supervisor:
        assert supervisor.stdin is not None and supervisor.stdout is not None
        # However long an interpreter takes to start, the fleet is not without a supervisor meanwhile.
        assert supervisor.stdout.readline() == b"ready\n"
        nursery = launch_nursery(run_dir)
        supervisor.stdin.write(b"go\n")
        supervisor.stdin.flush()
        pids = [int(pid) for pid in supervisor.stdout.readline().split()]
        supervisor.kill()
    assert len(pids) == len(IDS)
    return nursery, pids


@pytest.fixture
def orphans(tmp_path: Path) -> Iterator[subprocess.Popen[bytes]]:
    nursery, _ = orphaned(tmp_path, PATIENT)
    yield nursery
    nursery.terminate()
    nursery.wait(PATIENCE_S)


def test_a_new_supervisor_adopts_the_fleet_of_a_killed_one(
    orphans: subprocess.Popen[bytes], tmp_path: Path
) -> None:
    host = ProcessHost.adopt(tmp_path, 2)
    assert host.nursery_pid == orphans.pid
    assert host.granted_ms == dict.fromkeys(IDS, 300_000)
    repeated = {agent_id: [out.at_ms for out in reply.outputs] for agent_id, reply in host.repeated.items()}
    assert repeated == {agent_id: [300_000] for agent_id in IDS}
    reference = InProcessHost(FLEET, BIRTHS)
    theirs = coordinator(reference)
    for second in range(1, 11):
        theirs.advance(second * 1_000)
    present = last_truths(reference.take_truths())
    told = host.take_truths()
    assert last_truths(told) == {agent_id: present[agent_id] for agent_id in IDS}
    mine = Coordinator(host, host.granted_ms, TimeScale(THETA), now_ms=10_000)
    mine.advance(10_000)
    assert mine.advance(15_000) == theirs.advance(15_000)
    assert host.take_truths() == reference.take_truths()
    host.close()
    assert orphans.wait(PATIENCE_S) == 0


def test_an_old_supervisor_is_fenced_off(host: ProcessHost, tmp_path: Path) -> None:
    clock = coordinator(host)
    clock.advance(1_000)
    with pytest.raises(Fenced, match="epoch 1 is taken"):
        ProcessHost.adopt(tmp_path, 1)
    newer = ProcessHost.adopt(tmp_path, 2)
    with pytest.raises(Fenced, match="epoch 2"):
        clock.advance(2_000)
    with pytest.raises(Fenced, match="epoch 2"):
        host.restart(3, 30_000, ResetCause.BROWN_OUT)
    theirs = Coordinator(newer, newer.granted_ms, TimeScale(THETA), now_ms=1_000)
    theirs.advance(1_000)
    assert len(theirs.advance(2_000)) == 3
    # Its links still lead to the agents, which refuse it.
    stale = host.links.link(3)
    stale.send(WindowGrant((1, 99), Grant(60_000)).encode())
    assert len(theirs.advance(3_000)) == 3
    newer.close()


def test_a_nursery_that_dies_while_it_is_asked_for_an_agent_is_followed_by_another(host: ProcessHost) -> None:
    clock = coordinator(host)
    clock.advance(10_000)
    first, start = host._nursery, host._nursery.start

    def dies(rows: list[tuple[int, int, ResetCause, int, int]]) -> object:
        kill_9(first.pid)
        return start(rows)

    first.start = dies  # type: ignore[method-assign,assignment]
    kill_9(host.pids[8])
    died = deaths(clock.advance(11_000))
    assert died[0].agent_id == 8 and [it.gave_up for it in died if it.gave_up] == []
    # The others died with that nursery, and are started by the next one.
    died += deaths(clock.advance(12_000))
    assert {it.agent_id for it in died} == set(IDS) and clock.agent_ids == sorted(IDS)
    assert host.nursery_pid != first.pid


def test_a_whole_crash_is_resumed_from_the_file(orphans: subprocess.Popen[bytes], tmp_path: Path) -> None:
    orphans.kill()
    orphans.wait(PATIENCE_S)
    with closing(ProcessHost.adopt(tmp_path, 2)) as host:
        assert host.granted_ms == dict.fromkeys(IDS, 300_000)
        came = Coordinator(host, host.granted_ms, TimeScale(THETA), now_ms=10_000).advance(11_000)
        assert sorted(it.agent_id for it in deaths(came)) == heard(came) == list(IDS)


def test_an_orphaned_fleet_ends(tmp_path: Path) -> None:
    nursery, pids = orphaned(tmp_path, RestartPolicy(orphan_s=2.0))
    assert nursery.wait(PATIENCE_S) == 0
    assert all(gone(pid) for pid in pids)
    assert "no supervisor for 2 s: the fleet ends" in (tmp_path / "nursery.log").read_text()


def test_ending_is_bounded_though_an_agent_is_stopped(tmp_path: Path) -> None:
    ending_s = 0.2
    host = started(tmp_path, RestartPolicy(ending_s=ending_s))
    pids = dict(host.pids)
    # A process that has not stopped yet would meet the earlier SIGTERM first, and end by it.
    with standing_still(pids[8]):
        began_s = time.monotonic()
        host.close()
        # Nothing else is waited for; the room is for a machine that is busy. One that is stopped never ends by itself.
        assert ending_s <= time.monotonic() - began_s < ending_s + PATIENCE_S
    assert all(gone(pid) for pid in [*pids.values(), host.nursery_pid])


def test_a_fleet_whose_nursery_dies_again_and_again_is_lost(host: ProcessHost) -> None:
    clock = coordinator(host)
    clock.advance(1_000)
    died = deaths([])
    for second in range(2, 6):
        assert host.lost is None
        kill_nursery(host)
        died = deaths(clock.advance(second * 1_000))
    assert host.lost == "its nursery died 4 times within 60 s, and no other is started"
    assert [(it.agent_id, it.gave_up) for it in died] == [(agent_id, host.lost) for agent_id in IDS]
    assert clock.agent_ids == []


def test_a_nursery_that_cannot_start_is_tried_again_and_then_given_up(
    host: ProcessHost, monkeypatch: pytest.MonkeyPatch
) -> None:
    refused = Mock(side_effect=NurseryFailed("it has no room"))
    monkeypatch.setattr("agents.hosting.process_host.launch_nursery", refused)
    clock = coordinator(host)
    clock.advance(1_000)
    kill_nursery(host)
    clock.advance(2_000)
    assert refused.call_count == 3 and host.lost is not None and host.lost.endswith("(it has no room)")


def test_a_long_window_travels_in_parts(host: ProcessHost) -> None:
    reference = InProcessHost(FLEET, BIRTHS)
    grants = {agent_id: Grant(20_000 * THETA * 1_000 // 10) for agent_id in IDS}
    mine = host.grant(grants)
    assert mine == reference.grant(grants) and host.take_truths() == reference.take_truths()
    reply = mine[3]
    assert isinstance(reply, Reply) and sum(isinstance(out, WifiSent) for out in reply.outputs) == 2000


def test_agents_are_named_and_hold_few_descriptors(host: ProcessHost) -> None:
    coordinator(host).advance(0)
    for agent_id, pid in host.pids.items():
        assert Path(f"/proc/{pid}/comm").read_text() == f"amussel-{agent_id}\n"
        held = {int(entry.name): os.readlink(entry) for entry in Path(f"/proc/{pid}/fd").iterdir()}
        sockets = [path for path in held.values() if path.startswith("socket:")]
        assert len(sockets) == 2  # its link, and the truth socket that all share
        assert len(held) == 7  # with the physical file, the flash file and the three standard ones
