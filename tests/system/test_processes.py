"""A process per aMussel, with real processes: the same trace as one process, and what dies alone dies alone."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from itertools import accumulate
from pathlib import Path

import pytest
from fleets import PAPER
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from killing import gone, kill_9, standing_still

from agents.coordinator import AgentDied, Coordinator
from agents.fleet import resting_on_bottom
from agents.hosting.host import Grant, Host, Reply
from agents.hosting.in_process import InProcessHost
from agents.hosting.link_protocol import LIMIT_BYTES, WindowGrant, readable
from agents.hosting.process_host import Fenced, ProcessHost
from agents.mussel.outputs import Output, Truth, WifiSent
from agents.mussel.stimuli import AgentStimulus, ContactClosed, ContactOpened, DockMoved, SoundArrived
from agents.nursery import protocol
from agents.nursery.fleet_file import PHYSICAL_NAME, RestartPolicy
from agents.nursery.launch import NurseryFailed, StartedNursery, launch_nursery, prepare
from agents.nursery.state_file import RING_BYTES
from agents.time_scale import TimeScale
from firmware_model.packets import CommandPacket, Kind
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.power.charge import Flow
from firmware_model.states import State
from firmware_model.stimuli import ResetCause

pytestmark = pytest.mark.system

IDS = (3, 8, 21)
THETA = 30
PATIENCE_S = 180.0
FLEET = PAPER
BIRTHS = {agent_id: resting_on_bottom(0.0, agent_id, 3.0, 0.3, 1.0) for agent_id in IDS}
PATIENT = RestartPolicy(restarts=1000)


def command(kind: Kind, agent_id: int) -> SoundArrived:
    return SoundArrived(MusselbedCodec().encode(CommandPacket(kind, agent_id)))


def coordinator(host: Host) -> Coordinator:
    return Coordinator(host, dict.fromkeys(IDS, 0), TimeScale(THETA))


@pytest.fixture
def host(tmp_path: Path) -> Iterator[ProcessHost]:
    """With a watchdog that lets a busy machine take its time."""
    started = ProcessHost.start(tmp_path, FLEET, BIRTHS, window_timeout_s=PATIENCE_S, restart_policy=PATIENT)
    yield started
    started.close()
    assert gone(started.nursery_pid)


EVENTS = st.one_of(
    st.just("kill"),
    st.sampled_from([ContactClosed(1, 2), DockMoved(9, 9), ContactOpened()]),
    st.sampled_from(
        [command(kind, agent_id) for kind in (Kind.PERMISSION, Kind.RELEASE) for agent_id in IDS]
    ),
)
STORIES = st.lists(st.tuples(st.integers(0, 20), st.sampled_from(IDS), EVENTS), max_size=12)
Story = list[tuple[int, int, AgentStimulus | str]]


def fly(
    host: InProcessHost | ProcessHost, story: Story, steps_ms: list[int]
) -> tuple[list[Output | AgentDied], list[Truth]]:
    """Windows of the given lengths; an event of step k comes before that window, a kill as kill -9."""
    clock = coordinator(host)
    came: list[Output | AgentDied] = []
    told: list[Truth] = []
    now_ms = 0
    for step, length_ms in enumerate([0, *steps_ms]):
        now_ms += length_ms
        for _, agent_id, event in (entry for entry in story if entry[0] == step):
            if isinstance(event, str):
                kill(host, agent_id)
            else:
                clock.receive(agent_id, event, now_ms)
        came += clock.advance(now_ms)
        told += host.take_truths()
    return came, told


def kill(host: InProcessHost | ProcessHost, agent_id: int) -> None:
    if isinstance(host, InProcessHost):
        host.kill(agent_id)
    elif agent_id in host.pids:
        kill_9(host.pids[agent_id])  # perhaps killed before, and not granted since


@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(story=STORIES, steps_ms=st.lists(st.integers(1, 4000), min_size=5, max_size=20))
def test_one_process_and_many_give_the_same_trace(
    tmp_path_factory: pytest.TempPathFactory, story: Story, steps_ms: list[int]
) -> None:
    many = ProcessHost.start(
        tmp_path_factory.mktemp("run"),
        FLEET,
        BIRTHS,
        window_timeout_s=PATIENCE_S,
        restart_policy=PATIENT,
    )
    try:
        assert fly(many, story, steps_ms) == fly(InProcessHost(FLEET, BIRTHS), story, steps_ms)
        assert not many.dropped
    finally:
        many.close()


@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(
    story=STORIES,
    steps_ms=st.lists(st.sampled_from([1000, 1000, 1000, 1000, 2000, 700]), min_size=20, max_size=60),
)
def test_agents_that_run_ahead_give_the_same_trace(
    tmp_path_factory: pytest.TempPathFactory, story: Story, steps_ms: list[int]
) -> None:
    """A kill is noticed as soon as the killed agent's windows are used up: the death's time says when."""
    # A death at 0 ms may be of the first window or of the second.
    story = [entry for entry in story if entry[0] > 0]
    ahead = ProcessHost.start(
        tmp_path_factory.mktemp("run"),
        FLEET,
        BIRTHS,
        window_timeout_s=PATIENCE_S,
        restart_policy=PATIENT,
        looks_ahead=True,
    )
    try:
        came, told = fly(ahead, story, steps_ms)
        assert not ahead.dropped
    finally:
        ahead.close()
    ends_ms = [THETA * end_ms for end_ms in accumulate(steps_ms, initial=0)]
    noticed: Story = [
        (next(step for step, end_ms in enumerate(ends_ms) if end_ms > it.agent_ms), it.agent_id, "kill")
        for it in came
        if isinstance(it, AgentDied)
    ]
    facts = [entry for entry in story if entry[2] != "kill"]
    assert (came, told) == fly(InProcessHost(FLEET, BIRTHS), [*noticed, *facts], steps_ms)


def test_few_messages_pass_while_nothing_happens(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ahead = ProcessHost.start(tmp_path, FLEET, BIRTHS, looks_ahead=True)
    try:
        asked: list[dict[int, bytes]] = []
        ask = ahead.links.ask
        monkeypatch.setattr(ahead.links, "ask", lambda key, frames: asked.append(frames) or ask(key, frames))
        clock = coordinator(ahead)
        heard = [it for now_s in range(101) for it in clock.advance(1000 * now_s) if isinstance(it, Output)]
        assert len(heard) == 3 * 100
        assert len(asked) == 1
    finally:
        ahead.close()


def last_truths(truths: list[Truth]) -> dict[int, Truth]:
    return {truth.agent_id: truth for truth in truths}


def charging(host: ProcessHost) -> tuple[Coordinator, list[Truth]]:
    """aMussel 8 in a dock, charging at 10 s of mission time."""
    clock = coordinator(host)
    clock.receive(8, command(Kind.PERMISSION, 8), 1_000)
    clock.advance(1_000)
    clock.receive(8, ContactClosed(7_000_000, 8_000_000), 5_000)
    clock.advance(10_000)
    return clock, host.take_truths()


def test_kill_9_in_mid_charge_boots_and_charges_on(host: ProcessHost) -> None:
    clock, truths = charging(host)
    before = last_truths(truths)[8]
    assert before.state is State.CHARGING
    old_pid = host.pids[8]
    kill_9(old_pid)
    came = clock.advance(20_000)
    died = [it for it in came if isinstance(it, AgentDied)]
    assert [(it.agent_id, it.agent_ms, it.cause, it.reason, it.gave_up) for it in died] == [
        (8, 300_000, ResetCause.BROWN_OUT, "killed by SIGKILL", None)
    ]
    mine = [truth for truth in host.take_truths() if truth.agent_id == 8]
    assert [(truth.at_ms, truth.state) for truth in mine] == [
        (300_000, State.BOOTING),
        (302_000, State.CHARGING),
    ]
    assert all(
        truth.physical == before.physical for truth in mine
    )  # its battery's anchor and its place went on
    assert mine[-1].physical.primary.flow is Flow.CHARGING
    assert host.pids[8] != old_pid and gone(old_pid)


def test_an_idle_death_is_seen_in_the_next_window(host: ProcessHost) -> None:
    clock = coordinator(host)
    clock.advance(1_000)
    pids = dict(host.pids)
    for agent_id in IDS:
        kill_9(pids[agent_id])
    died = [it.agent_id for it in clock.advance(2_000) if isinstance(it, AgentDied)]
    assert died == sorted(IDS)


def test_a_stopped_agent_is_killed_by_the_watchdog(tmp_path: Path) -> None:
    host = ProcessHost.start(tmp_path, FLEET, BIRTHS, window_timeout_s=3.0, restart_policy=PATIENT)
    try:
        clock = coordinator(host)
        clock.advance(1_000)
        host.take_truths()
        with standing_still(host.pids[21]):
            came = clock.advance(2_000)
    finally:
        host.close()
    died = [it for it in came if isinstance(it, AgentDied)]
    assert [(it.agent_id, it.cause, it.reason) for it in died] == [
        (21, ResetCause.WATCHDOG, "no answer within 3 s: killed by the watchdog")
    ]
    assert sorted(it.agent_id for it in came if isinstance(it, Output)) == [3, 8, 21]


@pytest.mark.parametrize(
    "data", [b"", b"\xc1garbage", bytes(LIMIT_BYTES + 1)], ids=["empty", "garbage", "oversized"]
)
def test_a_bad_message_to_an_agent_disturbs_nothing(host: ProcessHost, data: bytes) -> None:
    reference = InProcessHost(FLEET, BIRTHS)
    mine, theirs = coordinator(host), coordinator(reference)
    assert mine.advance(1_000) == theirs.advance(1_000)
    host.links.link(3).send(data)
    assert mine.advance(2_000) == theirs.advance(2_000)
    assert host.take_truths() == reference.take_truths()
    assert sum(host.dropped.values()) == 1
    assert next(iter(host.dropped)).startswith("refused: ")


def test_a_bad_message_to_the_nursery_disturbs_nothing(host: ProcessHost, tmp_path: Path) -> None:
    clock = coordinator(host)
    with protocol.connect(str(tmp_path), 5.0) as guest:
        for data in (b"\xc1garbage", bytes(LIMIT_BYTES + 1), protocol.encode(protocol.End())):
            guest.send(data)
            answer = protocol.receive(guest)
            assert answer is not None and isinstance(answer[0], protocol.StartRefused)
    assert len(clock.advance(1_000)) == 3


def test_unknown_and_living_aMussels_are_not_started(host: ProcessHost) -> None:
    assert host.restart(99, 0, ResetCause.BROWN_OUT) == "aMussel 99 is not of this fleet"
    assert host.restart(8, 0, ResetCause.BROWN_OUT) == f"aMussel 8 lives already, as process {host.pids[8]}"
    assert len(coordinator(host).advance(1_000)) == 3


def test_ids_and_fleets_that_cannot_be(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="aMussel 65536: ids are 0 to 65535"):
        ProcessHost.start(tmp_path, FLEET, {65536: BIRTHS[3]})
    prepare(tmp_path, FLEET, BIRTHS)
    with pytest.raises(FileExistsError):
        prepare(tmp_path, FLEET, BIRTHS)


def test_a_second_nursery_has_no_place_in_a_run_directory(host: ProcessHost, tmp_path: Path) -> None:
    with pytest.raises(NurseryFailed, match="another nursery"):
        launch_nursery(tmp_path)
    assert len(coordinator(host).advance(1_000)) == 3


def test_a_nursery_that_nobody_waits_for_any_more_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare(tmp_path, FLEET, BIRTHS)

    def interrupted(reading: int, timeout_s: float) -> bool:
        # Not before it speaks: for a moment after it was begun, a process has no command line to be known by.
        assert readable(reading, timeout_s) and running_for(tmp_path) != []
        raise KeyboardInterrupt

    monkeypatch.setattr("agents.nursery.launch.readable", interrupted)
    with pytest.raises(KeyboardInterrupt):
        launch_nursery(tmp_path)
    assert running_for(tmp_path) == []


def test_a_nursery_is_ended_only_as_long_as_its_starter_has_not_waited_for_it(tmp_path: Path) -> None:
    prepare(tmp_path, FLEET, BIRTHS)
    abandoned = StartedNursery(tmp_path)
    abandoned.end()
    assert running_for(tmp_path) == []
    waited_for = StartedNursery(tmp_path)
    process = waited_for.ready()
    try:
        waited_for.end()
        assert process.poll() is None
    finally:
        process.kill()
        process.wait()


def running_for(run_dir: Path) -> list[str]:
    """The processes that were started with this run directory, by number."""
    return [
        it.name
        for it in Path("/proc").iterdir()
        if it.name.isdigit() and it.name != str(os.getpid()) and str(run_dir).encode() in command_line(it)
    ]


def command_line(process: Path) -> bytes:
    try:
        return (process / "cmdline").read_bytes()
    except OSError:  # it has ended
        return b""


def killed_each_second(run_dir: Path, restart_policy: RestartPolicy, kills: int) -> list[str | None]:
    """Kills aMussel 3 in each of so many ticks; why it stays dead, by tick. A tick is 30 s of its time, boots included."""
    host = ProcessHost.start(run_dir, FLEET, BIRTHS, restart_policy=restart_policy)
    try:
        clock = coordinator(host)
        gave_up: list[str | None] = []
        for second in range(1, kills + 1):
            kill_9(host.pids[3])
            gave_up += [it.gave_up for it in clock.advance(second * 1_000) if isinstance(it, AgentDied)]
        alive = [3, 8, 21] if gave_up[-1] is None else [8, 21]
        assert clock.agent_ids == alive
        assert len(clock.advance(1_000 * (kills + 1))) == len(alive)
        return gave_up
    finally:
        host.close()


def test_an_agent_that_dies_at_once_again_and_again_stays_dead(tmp_path: Path) -> None:
    assert killed_each_second(tmp_path, RestartPolicy(restarts=2, settled_s=600.0), kills=3) == [
        None,
        None,
        "aMussel 3 was restarted 2 times in a row and lived for less than 600 s of its time after each boot: "
        "it stays dead",
    ]


def test_an_agent_that_lived_in_between_is_restarted_for_ever(tmp_path: Path) -> None:
    assert killed_each_second(tmp_path, RestartPolicy(restarts=2), kills=12) == [None] * 12


@pytest.mark.parametrize("bytes_of_each", [4096, 2 * RING_BYTES])
def test_a_fleet_whose_states_another_version_wrote_is_not_born_anew(
    tmp_path: Path, bytes_of_each: int
) -> None:
    prepare(tmp_path, FLEET, BIRTHS)
    (tmp_path / PHYSICAL_NAME).write_bytes(b"kept" * (bytes_of_each * len(IDS) // 4))
    with pytest.raises(NurseryFailed, match="another version of musselbed wrote it"):
        launch_nursery(tmp_path)
    assert (tmp_path / PHYSICAL_NAME).read_bytes().startswith(b"kept")


def test_a_nursery_that_died_while_it_wrote_the_first_states_leaves_a_fleet_that_can_begin(
    tmp_path: Path,
) -> None:
    prepare(tmp_path, FLEET, BIRTHS)
    (tmp_path / PHYSICAL_NAME).write_bytes(bytes(RING_BYTES + 150))  # the second aMussel's record is the last
    with launch_nursery(tmp_path) as nursery:
        host = ProcessHost.adopt(tmp_path, 1)
        assert list(host.granted_ms) == list(IDS)
        host.close()
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
    assert {agent_id: [out.at_ms for out in reply.outputs] for agent_id, reply in host.repeated.items()} == (
        {agent_id: [300_000] for agent_id in IDS}
    )
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


def test_agents_die_with_their_nursery_and_its_file_starts_them_again(host: ProcessHost) -> None:
    clock, truths = charging(host)
    before = last_truths(truths)
    pids = dict(host.pids)
    first = host.nursery_pid
    kill_9(first)
    assert all(gone(pid) for pid in pids.values())
    came = clock.advance(11_000)
    assert [(it.agent_id, it.reason) for it in came if isinstance(it, AgentDied)] == [
        (agent_id, "its nursery died") for agent_id in IDS
    ]
    assert host.nursery_pid != first and set(host.pids) == set(IDS)
    booted = {
        truth.agent_id: truth
        for truth in host.take_truths()
        if truth.at_ms == 300_000 and truth.state is State.BOOTING
    }
    assert {agent_id: truth.physical for agent_id, truth in booted.items()} == (
        {agent_id: before[agent_id].physical for agent_id in IDS}
    )


def test_a_nursery_that_dies_while_it_is_asked_for_an_agent_is_followed_by_another(host: ProcessHost) -> None:
    clock = coordinator(host)
    clock.advance(10_000)
    first, start = host._nursery, host._nursery.start

    def dies(rows: list[tuple[int, int, ResetCause, int, int]]) -> object:
        kill_9(first.pid)
        return start(rows)

    first.start = dies  # type: ignore[method-assign,assignment]
    kill_9(host.pids[8])
    died = [it for it in clock.advance(11_000) if isinstance(it, AgentDied)]
    assert died[0].agent_id == 8 and [it.gave_up for it in died if it.gave_up] == []
    # The others died with that nursery, and are started by the next one.
    died += [it for it in clock.advance(12_000) if isinstance(it, AgentDied)]
    assert {it.agent_id for it in died} == set(IDS) and clock.agent_ids == sorted(IDS)
    assert host.nursery_pid != first.pid


def test_a_whole_crash_is_resumed_from_the_file(orphans: subprocess.Popen[bytes], tmp_path: Path) -> None:
    orphans.kill()
    orphans.wait(PATIENCE_S)
    host = ProcessHost.adopt(tmp_path, 2)
    try:
        assert host.granted_ms == dict.fromkeys(IDS, 300_000)
        clock = Coordinator(host, host.granted_ms, TimeScale(THETA), now_ms=10_000)
        came = clock.advance(11_000)
        assert sorted(it.agent_id for it in came if isinstance(it, AgentDied)) == list(IDS)
        assert sorted(it.agent_id for it in came if isinstance(it, Output)) == list(IDS)
    finally:
        host.close()


def test_an_orphaned_fleet_ends(tmp_path: Path) -> None:
    nursery, pids = orphaned(tmp_path, RestartPolicy(orphan_s=3.0))
    assert nursery.wait(PATIENCE_S) == 0
    assert all(gone(pid) for pid in pids)
    assert "no supervisor for 3 s: the fleet ends" in (tmp_path / "nursery.log").read_text()


def test_ending_is_bounded_though_an_agent_is_stopped(tmp_path: Path) -> None:
    ending_s = 0.2
    host = ProcessHost.start(tmp_path, FLEET, BIRTHS, restart_policy=RestartPolicy(ending_s=ending_s))
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
    died: list[AgentDied] = []
    for second in range(2, 6):
        assert host.lost is None
        pids = dict(host.pids)
        kill_9(host.nursery_pid)
        assert all(gone(pid) for pid in pids.values())
        died = [it for it in clock.advance(second * 1_000) if isinstance(it, AgentDied)]
    assert host.lost == "its nursery died 4 times within 60 s, and no other is started"
    assert [(it.agent_id, it.gave_up) for it in died] == [(agent_id, host.lost) for agent_id in IDS]
    assert clock.agent_ids == []


def test_a_nursery_that_cannot_start_is_tried_again_and_then_given_up(
    host: ProcessHost, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = []

    def refuse(run_dir: str) -> subprocess.Popen[bytes]:
        tried.append(run_dir)
        raise NurseryFailed("it has no room")

    monkeypatch.setattr("agents.hosting.process_host.launch_nursery", refuse)
    clock = coordinator(host)
    clock.advance(1_000)
    pids = dict(host.pids)
    kill_9(host.nursery_pid)
    assert all(gone(pid) for pid in pids.values())
    clock.advance(2_000)
    assert len(tried) == 3 and host.lost is not None and host.lost.endswith("(it has no room)")


def test_a_long_window_travels_in_parts(host: ProcessHost) -> None:
    reference = InProcessHost(FLEET, BIRTHS)
    grants = {agent_id: Grant(20_000 * THETA * 1_000 // 10) for agent_id in IDS}
    mine, theirs = host.grant(grants), reference.grant(grants)
    assert mine == theirs
    reply = mine[3]
    assert isinstance(reply, Reply) and sum(isinstance(out, WifiSent) for out in reply.outputs) == 2000
    assert host.take_truths() == reference.take_truths()


def test_agents_are_named_and_hold_few_descriptors(host: ProcessHost) -> None:
    coordinator(host).advance(0)
    for agent_id, pid in host.pids.items():
        assert Path(f"/proc/{pid}/comm").read_text() == f"amussel-{agent_id}\n"
        held = {int(entry.name): os.readlink(entry) for entry in Path(f"/proc/{pid}/fd").iterdir()}
        sockets = [path for path in held.values() if path.startswith("socket:")]
        assert len(sockets) == 2  # its link, and the truth socket that all share
        assert len(held) == 7  # with the physical file, the flash file and the three standard ones
