"""One mission over ROS with twelve simulated aMussels and three of our nodes, which change between simulated and real.

Run it by `.venv/bin/musselbed python tests/counterparts/own_node/hand_overs.py`. The last line on stdout is the result, as
JSON; the exit code is 1 where a packet went to a wrong aMussel or a take_back was undone. Where a node is real, a bridge of
its own carries it, by a modem and by UDP; where it is simulated that bridge has ended. A node lives on meanwhile, and each
of its stays in the water has a new place.
"""

import argparse
import csv
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from bisect import bisect_left, bisect_right
from collections import Counter
from math import hypot, isfinite
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
SCENARIOS = HERE.parents[2] / "launch_scripts" / "scenarios"
CODEC = HERE.parents[1] / "shared" / "own_node_codec"
sys.path[:0] = [str(CODEC), str(Path(sys.prefix) / "share" / "musselbed" / "ros")]
from own_node_codec import NUMBERS, ORIGIN_DEG, metres_per_degree  # noqa: E402

SITES = {13: (26.0, 13.0), 14: (9.0, 16.5), 15: (24.0, 1.0)}
"""The place of a node's first stay, north and east; that of the k-th lies k STEP_M farther east."""
STEP_M = 0.25
NEAR_M = 0.12
DRAIN_PER_S = 0.00104 / 60
FACTORS = {13: 1.0, 14: 1.03, 15: 0.97}
LOAD_PER_S = 1 / (8 * 3600)
PATIENCE_S = 420.0
SETTLED_S = 2.0
"""A claim that still holds makes an aMussel real again within this time after a take_back."""

TWIN = """
beliefs:
  estimator: twin
  twin: {drain_deviation: 0.05, sensor_noise: 0.005, bias_deviation: 0.02, unscheduled: 0.01, fix_deviation_m: 0.05}
"""


def scenario(folder: Path, given: argparse.Namespace) -> Path:
    """The pool with three more aMussels, each some decimetres from its node's first place."""
    text = (SCENARIOS / "pool-12.yaml").read_text()
    starts = (SCENARIOS / "pool-12.csv").read_text()
    for agent_id, (north, east) in SITES.items():
        starts += f"{agent_id},{north - 0.5},{east},{given.charge}\n"
    (folder / "own-15.csv").write_text(starts)
    for old, new in (
        ("name: pool-12", "name: own-15"),
        ("theta: 30", f"theta: {given.theta}"),
        ("duration_s: 2400", "duration_s: 14400"),
        ("count: 12", "count: 15"),
        ("pool-12.csv", "own-15.csv"),
        ("{mode: paper, amplitude_m: 0.005}", "{mode: physical}"),
        ("pool_threshold: 0.8", f"pool_threshold: {given.threshold}"),
        ("report_period_s: 1}", "report_period_s: 5}"),
    ):
        assert old in text, old
        text = text.replace(old, new)
    file = folder / "own-15.yaml"
    file.write_text(text + (TWIN if given.estimator == "twin" else ""))
    return file


class Program:
    """A process of ours, with its lines."""

    def __init__(self, name: str, words: list[object], folder: Path, env: dict[str, str]) -> None:
        self.lines: list[str] = []
        self._log = (folder / f"{name}.log").open("a")
        self.process = subprocess.Popen(
            [str(word) for word in words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=folder,
            env=env,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append(line)
            self._log.write(line)
            self._log.flush()

    def tell(self, line: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def end(self, patience_s: float = 60.0) -> int | None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            try:
                self.process.wait(patience_s)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        self._reader.join(5)
        return self.process.returncode


class Node:
    def __init__(
        self,
        agent_id: int,
        place: int,
        port: int,
        charge: float,
        folder: Path,
        rate: float,
        env: dict[str, str],
    ) -> None:
        self.agent_id, self.number, self.stays = agent_id, NUMBERS[agent_id], 0
        self.apad_modem, self.port = folder / f"table/modem{place}", port
        latitude, longitude = degrees(*self.site(0))
        self.program = Program(
            f"node{agent_id}",
            [
                sys.executable,
                HERE / "node.py",
                "--udp",
                f"127.0.0.1:{port}",
                "--serial",
                folder / f"table/modem{place + 3}",
                "--number",
                self.number,
                "--charge",
                charge,
                "--place",
                latitude,
                longitude,
                "--every",
                3 * rate,
                "--rate",
                rate,
                "--load",
                LOAD_PER_S,
                "--drain",
                DRAIN_PER_S * FACTORS[agent_id],
            ],
            folder,
            env,
        )

    def site(self, stay: int) -> tuple[float, float]:
        north, east = SITES[self.agent_id]
        return north, east + stay * STEP_M

    def put_down(self) -> None:
        self.stays += 1
        latitude, longitude = degrees(*self.site(self.stays))
        self.program.tell(f"place {latitude} {longitude}")

    def told(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in list(self.program.lines) if line.startswith("{")]


def degrees(north_m: float, east_m: float) -> tuple[float, float]:
    north, east = metres_per_degree(ORIGIN_DEG[0])
    return ORIGIN_DEG[0] + north_m / north, ORIGIN_DEG[1] + east_m / east


class Mission:
    """What the graph tells: beliefs by mission time, changes and docks."""

    def __init__(self, nodes: dict[int, Node]) -> None:
        import rospy
        from musselbed_msgs.msg import FleetBeliefs, MissionEvent
        from musselbed_msgs.srv import AmusselById

        self.nodes = nodes
        self.samples: list[tuple[int, float, dict[int, Any]]] = []
        self.presences: list[dict[str, Any]] = []
        self.docked: set[int] = set()
        self.refusals: Counter[str] = Counter()
        rospy.init_node("hand_overs", disable_signals=True)
        rospy.Subscriber("/musselbed/beliefs", FleetBeliefs, self._believe, queue_size=1000)
        rospy.Subscriber("/musselbed/mission", MissionEvent, self._event, queue_size=1000)
        rospy.wait_for_service("/musselbed/take_back", timeout=60)
        self._take_back = rospy.ServiceProxy("/musselbed/take_back", AmusselById)

    def _believe(self, message: Any) -> None:
        ours = {it.id: it for it in message.agents if it.id in SITES}
        self.samples.append((message.mission_time_ms, time.time(), ours))

    def _event(self, message: Any) -> None:
        facts = json.loads(message.data)
        if message.kind == "presence" and facts["id"] in SITES:
            self.presences.append({"t": message.mission_time_ms, **facts})
        if message.kind == "dock" and facts["agent"] in SITES:
            (self.docked.add if facts["closed"] else self.docked.discard)(facts["agent"])
            self.nodes[facts["agent"]].program.tell("dock" if facts["closed"] else "undock")

    def presence(self, agent_id: int) -> str:
        return next((it["is"] for it in reversed(self.presences) if it["id"] == agent_id), "simulated")

    def take_back(self, agent_id: int) -> bool:
        answer = self._take_back(id=agent_id)
        if not answer.accepted:
            self.refusals[re.sub(r"\d+", "N", answer.message)] += 1
        return bool(answer.accepted)


def until(holds: Any, what: str, patience_s: float = PATIENCE_S) -> None:
    end = time.monotonic() + patience_s
    while not holds():
        if time.monotonic() > end:
            raise TimeoutError(what)
        time.sleep(0.1)


class Changes(threading.Thread):
    """One node's changes, from its first bridge on."""

    def __init__(
        self, node: Node, mission: Mission, run: Path, given: argparse.Namespace, env: dict[str, str]
    ) -> None:
        super().__init__(daemon=True)
        self.node, self.mission, self.run_directory, self.given, self.env = node, mission, run, given, env
        self.problems: list[str] = []
        self.carried: Counter[str] = Counter()
        self.undone = 0
        self.bridge: Program | None = None

    def run(self) -> None:
        node, _mission = self.node, self.mission
        time.sleep(self.given.dwell * (node.agent_id - 13) / 3 * 2)
        for _ in range(self.given.rounds):
            try:
                self._one_round()
            except (TimeoutError, OSError) as error:
                self.problems.append(f"{node.agent_id}: {error}")
                if self.bridge:
                    self.bridge.end()

    def _one_round(self) -> None:
        node, mission = self.node, self.mission
        words = ("musselbed", "bridge", self.run_directory, node.apad_modem, f"udp:{node.port}")
        options = ("--ids", node.agent_id, "--codec", "own-node", "--json")
        self.bridge = Program(
            f"bridge{node.agent_id}", [*words, *options], self.run_directory.parent, self.env
        )
        until(lambda: mission.presence(node.agent_id) == "real", "it never became real")
        time.sleep(self.given.dwell)
        self.bridge.end()
        for line in self.bridge.lines:
            if line.startswith("{"):
                self.carried.update(json.loads(line).get("counts", {}))
        time.sleep(self.given.lease)
        end = time.monotonic() + PATIENCE_S
        while True:
            if time.monotonic() > end:
                raise TimeoutError("take_back was refused or undone for too long")
            if mission.take_back(node.agent_id):
                until(lambda: mission.presence(node.agent_id) == "simulated", "it never became simulated")
                time.sleep(SETTLED_S)
                if mission.presence(node.agent_id) == "simulated":
                    break
                self.undone += 1
            time.sleep(2)
        time.sleep(max(0.0, self.given.dwell / 2 - SETTLED_S))
        node.put_down()
        time.sleep(self.given.dwell / 2)


def charges_of(node: Node) -> tuple[list[float], list[float]]:
    rows = [it for it in node.told() if "charge" in it]
    return [it["wall"] for it in rows], [it["charge"] for it in rows]


def at(times: list[float], values: list[float], time_: float) -> float | None:
    """Between two rows by a straight line."""
    i = bisect_right(times, time_)
    if i == 0 or i == len(times):
        return values[min(i, len(times) - 1)] if times else None
    share = (time_ - times[i - 1]) / (times[i] - times[i - 1])
    return values[i - 1] + share * (values[i] - values[i - 1])


def truths(run: Path, folder: Path, env: dict[str, str]) -> dict[int, tuple[list[float], list[float]]]:
    """The true charge of each simulated aMussel by mission milliseconds, from the run's own export."""
    subprocess.run(
        ["musselbed", "export", run, "--to", "csv"], cwd=folder, env=env, check=True, capture_output=True
    )
    file = next(run.rglob("truth.csv"), None) or next(folder.rglob("truth.csv"))
    found: dict[int, tuple[list[float], list[float]]] = {it: ([], []) for it in SITES}
    with file.open() as lines:
        for row in csv.DictReader(lines):
            agent_id = int(row["id"])
            if agent_id in found:
                moment = float(row["mission_time_ms"])
                found[agent_id][0].append(moment)
                found[agent_id][1].append(float(row["primary"]))
    return found


def judge_changes(mission: Mission, true: dict[int, tuple[list[float], list[float]]]) -> list[dict[str, Any]]:
    changes = []
    moments = [it[0] for it in mission.samples]
    for change in mission.presences:
        agent_id, t = change["id"], change["t"]
        first = bisect_left(moments, t)
        before = mission.samples[first - 1] if first else None
        later = [it for it in mission.samples[first:] if agent_id in it[2]]
        after = next((it for it in later if it[0] - 1000 * it[2][agent_id].age_s > t), None)
        real = change["is"] == "real"
        row: dict[str, Any] = {"t": t, "id": agent_id, "to": change["is"]}
        row["unbelieved_s"] = (later[0][0] - t) / 1000 if later and later[0][0] > t + 1000 else 0
        for name, sample, of_node in (("before", before, not real), ("after", after, real)):
            if sample is None or agent_id not in sample[2]:
                row[name] = None
                continue
            belief = sample[2][agent_id]
            truth = (
                at(*charges_of(mission.nodes[agent_id]), sample[1])
                if of_node
                else at(*true[agent_id], sample[0])
            )
            sd = belief.charge_deviation if isfinite(belief.charge_deviation) else None
            row[name] = {
                "t": sample[0],
                "belief": round(belief.charge, 4),
                "sd": None if sd is None else round(sd, 4),
                "low": round(belief.charge_low, 4) if isfinite(belief.charge_low) else None,
                "high": round(belief.charge_high, 4) if isfinite(belief.charge_high) else None,
                "true": None if truth is None else round(truth, 4),
            }
        if row["before"] and row["after"] and row["before"]["sd"]:
            row["jump_in_sd"] = round(
                (row["after"]["belief"] - row["before"]["belief"]) / row["before"]["sd"], 2
            )
        changes.append(row)
    return changes


def judge_places(journal: Path, nodes: dict[int, Node]) -> tuple[int, int, list[str]]:
    """Beliefs at a node's place, and those among them that are another aMussel's. One in a dock is where the aPad is."""
    sites = [(node.agent_id, node.site(stay)) for node in nodes.values() for stay in range(node.stays + 1)]
    right, wrong, examples = 0, 0, []
    docked: set[int] = set()
    for line in journal.read_text().splitlines():
        facts = json.loads(line)
        if facts["kind"] == "dock":
            (docked.add if facts["closed"] else docked.discard)(facts["agent"])
        if facts["kind"] != "belief" or facts["id"] in docked:
            continue
        owners = {
            owner
            for owner, (north, east) in sites
            if hypot(facts["north_m"] - north, facts["east_m"] - east) < NEAR_M
        }
        if facts["id"] in owners:
            right += 1
        elif owners:
            wrong += 1
            examples.append(line)
    return right, wrong, examples[:5]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=7, help="changes each way of each node")
    parser.add_argument("--dwell", type=float, default=8.0, help="wall seconds from change to change")
    parser.add_argument(
        "--lease", type=float, default=0.0, help="wall seconds from a bridge's end to take_back"
    )
    parser.add_argument("--speed", type=float, default=2.0)
    parser.add_argument(
        "--rate", type=float, help="the nodes' own seconds in a wall second (default: theta x speed)"
    )
    parser.add_argument("--theta", type=int, default=30)
    parser.add_argument("--charge", type=float, default=0.85, help="of the three at the start")
    parser.add_argument("--threshold", type=float, default=0.7, help="the mission's pool_threshold")
    parser.add_argument("--estimator", choices=("twin", "hold_last"), default="twin")
    parser.add_argument("--port", type=int, default=5113, help="the first of three UDP ports")
    parser.add_argument("--folder", type=Path, help="for the run and the logs (default: a new one)")
    parser.add_argument("--limit", type=float, default=900.0, help="wall seconds at most")
    given = parser.parse_args()
    folder = (given.folder or Path(tempfile.mkdtemp(prefix="hand_overs-"))).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    run, env = folder / "run", dict(os.environ)
    began = time.monotonic()
    env["PYTHONUNBUFFERED"] = "1"
    env["PYTHONPATH"] = str(CODEC)
    env["PATH"] = f"{Path(sys.executable).parent}:{env['PATH']}"
    programs = [Program("modems", ["musselbed", "modems", "table", "--count", 6], folder, env)]
    try:
        words = ("musselbed", "run", scenario(folder, given), "--speed", given.speed, "--out", run)
        flight = Program("run", list(words), folder, env)
        programs.append(flight)
        until(lambda: (run / "run.json").exists() and (folder / "table/modem6").exists(), "no run")
        until(lambda: json.loads((run / "run.json").read_text()).get("master_uri"), "no master")
        env["ROS_MASTER_URI"] = os.environ["ROS_MASTER_URI"] = json.loads((run / "run.json").read_text())[
            "master_uri"
        ]
        rate = given.rate or given.speed * given.theta
        nodes: dict[int, Node] = {}
        mission = Mission(nodes)
        until(lambda: mission.samples and all(it in mission.samples[-1][2] for it in SITES), "no beliefs")
        for place, agent_id in enumerate(SITES, 1):
            nodes[agent_id] = Node(agent_id, place, given.port + place - 1, given.charge, folder, rate, env)
            programs.append(nodes[agent_id].program)
        threads = [Changes(node, mission, run, given, env) for node in nodes.values()]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(max(1.0, given.limit - (time.monotonic() - began)))
            if thread.is_alive():
                thread.problems.append(f"{thread.node.agent_id}: the time was over")
            if thread.bridge:
                thread.bridge.end()
        flight_code = flight.end(120)
    finally:
        for program in reversed(programs):
            program.end()
    summary = json.loads((run / "summary.json").read_text())
    changes = judge_changes(mission, truths(run, folder, env))
    right, wrong, examples = judge_places(run / "journal.jsonl", nodes)
    whole = [it for it in changes if it["before"] and it["after"]]

    def share_inside(name: str) -> str:
        sides = [it[name] for it in whole if it[name]["low"] is not None and it[name]["true"] is not None]
        inside = sum(it["low"] <= it["true"] <= it["high"] for it in sides)
        return f"{inside} of {len(sides)}"

    result = {
        "scenario": {"theta": given.theta, "speed": given.speed, "estimator": given.estimator},
        "to_real": sum(it["is"] == "real" for it in mission.presences),
        "to_simulated": sum(it["is"] == "simulated" for it in mission.presences),
        "packets_sent": sum("sent" in it for node in nodes.values() for it in node.told()),
        "carried_by_bridges": dict(sum((it.carried for it in threads), Counter())),
        "words_heard": dict(
            Counter(it["word"] for node in nodes.values() for it in node.told() if "word" in it)
        ),
        "beliefs_at_own_place": right,
        "beliefs_at_a_wrong_place": wrong,
        "wrong_examples": examples,
        "true_before_in_interval": share_inside("before"),
        "true_after_in_interval": share_inside("after"),
        "largest_jump": max(
            (abs(it["after"]["belief"] - it["before"]["belief"]) for it in whole), default=None
        ),
        "longest_unbelieved_s": max((it["unbelieved_s"] for it in changes), default=0),
        "refusals": dict(mission.refusals),
        "take_backs_undone": sum(it.undone for it in threads),
        "problems": [problem for thread in threads for problem in thread.problems],
        "dropped": summary["dropped"],
        "excluded": summary["excluded"],
        "flight_exit_code": flight_code,
        "wall_s": round(time.monotonic() - began),
        "folder": str(folder),
        "changes": changes,
    }
    print(json.dumps(result))
    undone, problems = result["take_backs_undone"], result["problems"]
    if wrong or undone or problems or min(result["to_real"], result["to_simulated"]) < 3 * given.rounds:
        sys.exit(1)


if __name__ == "__main__":
    main()
