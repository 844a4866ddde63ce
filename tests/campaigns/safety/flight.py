"""One flight on two machines: a vehicle's computer with master, hull, relay and watchdog, and a laptop with the bench.

The machines are network namespaces, and the cable between them is a process that can cut, lose and delay. `Flight` starts
all of it, does to it what a row asks for, and keeps the facts of the wire. It does not judge.
"""

from __future__ import annotations

import json
import math
import os
import random
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from older_pythons import older_python
from tries import NoFlight
from two_machines import Link, Lose, Machine, Programs, linked_machines, master_uri

from safety.judge import PERCH
from safety.person import ANSWER_S, COMMAND, PAGE, Pressed
from safety.track import Fact, Place

ROOT = Path(__file__).parents[3]
NODES = Path(__file__).with_name("nodes")
PATH = f"{ROOT}:{Path(__file__).parents[1]}"
"""For programs of ours: the bench, and this campaign."""
COUNTERPART = ROOT / "tests" / "counterparts" / "generation_b" / "vehicle.py"
"""A vehicle of generation B by a stranger, in the place of our simulated hull."""
SCENARIO = ROOT / "launch_scripts" / "scenarios" / "real-apad.yaml"
BY_EYE = SCENARIO.with_name("pool-12-camera.yaml")
SIDE_M = 80.0
FENCE: tuple[Place, ...] = ((0.0, 0.0), (SIDE_M, 0.0), (SIDE_M, SIDE_M), (0.0, SIDE_M))
START_M: Place = (40.0, 40.0)
CORNERS: tuple[Place, ...] = ((59.0, 57.0), (56.0, 22.0), (23.0, 24.0), (24.0, 58.0))
"""The aMussels' places: a leg of 23 m takes the vehicle 45 s."""
SHIFT_M = 2.0
SHORE_M = 15.0
"""The fence's clearance, and some."""
LOW, SHORT_CHARGE = 0.77, 0.81
"""Around the pool's threshold of 0.8: a dock lets one go so soon that a vehicle rests for little more than a minute."""
LANES_M = (12.0, 26.0, 40.0, 54.0, 68.0)
LANE_ENDS_M = (62.0, 18.0)
"""Several aPads start side by side, each with an aMussel ahead and one behind."""
HULL, TRUTH = "/hull/position", "/hull/truth"
"""Our hull publishes its true place for the relay. The counterpart publishes there what its navigation believes."""
UNDER_WAY_M = 2.0
NEVER_OVERRIDDEN = ("bench", "fence", "position", "pilot", "stop")
CALL_S = 0.4
_ENDS = ((61.0, 58.0), (61.0, 56.0))
"""Two places near each other: the way to either is long, and each order is a new one."""
_WAYS = f"""
ends = {_ENDS}
while True:
    try:
        api.go_to_local(*ends[0])
    except Exception as refused:
        print("not taken:", refused)
    ends = ends[::-1]
    time.sleep(1)
"""
"""A script that goes on ordering, whatever comes of it. Its end is that of the flight."""
PATIENCE_S = 60.0
RESUMES = 5
BEGIN_S = 180.0
IMC_PORT = 16_001
BATTERY_WH, IDLE_HOURS = 50_000.0, 800.0
"""Hours of flight must not depend on the vehicle's charge; rows that are about it falsify what it tells."""


@dataclass(frozen=True, slots=True)
class Setup:
    """The differences of a flight from a plain one."""

    clock_off_s: float = 0.0
    """The vehicle's wall clock against the laptop's."""
    current_m_s: Place = (0.0, 0.0)
    near_m: float | None = None
    """The first aMussel floats so far from the start; by default all are far."""
    full: bool = False
    """The laptop's disk can be filled: the run's folder is a small file system of its own."""
    watchdog: bool = True
    watchdog_python: str = ""
    """The version of the Python that runs the watchdog; by default the machine's."""
    fault: str | None = None
    """A fault of the simulated vehicle, as its scenario names it."""
    docks_by_eye: bool = False
    """Generation B docks by its own primitive, before the bench's camera."""
    silence_s: float = 10.0
    ahead_m: float = 8.0
    """The way that lies ahead when the flight is handed over."""
    rests: bool = False
    """All aMussels are full and age as the clock goes: the vehicle holds its place for hours."""
    flies: str = "mission"
    """`script`: a script orders a go-to each second, for ever. `calls`: a program calls for one each 0.4 s."""
    arm_moves: bool = False
    """The arm stands open in a docking of generation B."""
    apads: int = 1
    """Several aPads have no relay: their hulls publish the truth themselves."""
    amussels: int = 0
    """So many anywhere in the square, and short charges, so that the aPads are always at work; 0 for a few far ones."""
    is_our_own: bool = False
    """The bench starts master and simulated vehicle itself, on the laptop, and restarts a supervisor that died."""
    guards: dict[str, Any] = field(default_factory=dict)
    """Differences of the scenario's `guards`."""
    run_words: tuple[str, ...] = ()


@dataclass
class Flight:
    """A flight in `home`, which ends with `stack`."""

    home: Path
    generation: str
    rng: random.Random
    setup: Setup
    stack: ExitStack
    duration_s: float = 3600.0
    """The mission's."""
    is_counterpart: bool = False
    """The vehicle is COUNTERPART, which knows no fault of `nodes/hull.py`."""
    ended: threading.Event = field(default_factory=threading.Event)
    """Set from outside: the campaign ends, and this flight with it."""
    facts: list[Fact] = field(default_factory=list)
    despite: list[str] = field(default_factory=list)
    vehicle: Machine = field(init=False)
    bench: Machine = field(init=False)
    link: Lose = field(init=False)
    programs: Programs = field(init=False)
    runs: list[str] = field(default_factory=list)
    """The names under which the bench's commands that fly were started."""
    _processes: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)
    _read_bytes: int = 0
    _starts: int = 0

    def begin(self) -> None:
        """Returns when the vehicle is under way; NoFlight when it does not come to that."""
        self.vehicle, self.bench, self.link = self.stack.enter_context(linked_machines(Link()))
        self.stack.callback(self._end_laptop)
        self.programs = Programs(self.home, master_uri(self.vehicle), self.stack, PATIENCE_S)
        self.scenario = self._write_scenario("scenario", START_M)
        self._write_fleet()
        if self.setup.full:
            self._mount_small_disk()
        self._watch()
        if not self.setup.is_our_own:
            self.boot("hull", START_M)
            self.actor("stranger")
        self._fly()

    @property
    def names(self) -> list[str]:
        """The aPads'."""
        return [f"apad{number}" for number in range(1, self.setup.apads + 1)]

    def _watch(self) -> None:
        """Reads the wire where the vehicle is."""
        words = [sys.executable, "-m", "safety.wire"]
        is_relayed = self.setup.apads == 1 and not self.setup.is_our_own
        for name in self.names:
            words += [f"/{name}", f"/{name}_simulated", HULL if is_relayed else f"/{name}/position"]
        if self.is_counterpart:
            words[-2:] = ["/apad1/vehicle", TRUTH]
        machine = self.bench if self.setup.is_our_own else self.vehicle
        self._processes["wire"] = self.programs.start(
            machine, "wire", *words, environment={"PYTHONPATH": PATH}
        )
        self._wait_for("wire", "wire", "reading")

    # What flies.

    def boot(self, name: str, start_m: Place) -> None:
        """Starts all that runs on the vehicle's computer; the hull's scenario is kept as `name`."""
        self._starts += 1
        clock, off_s = [], self.setup.clock_off_s
        environment = {"PYTHONPATH": PATH}
        if off_s:
            clock = ["faketime", "--exclude-monotonic", "-f", f"{off_s:+g}s"]
            environment["PYTHONPATH"] += f":{ROOT / 'tests' / 'shared' / 'beside_faketime'}"
        self._processes["master"] = self.programs.start(
            self.vehicle,
            f"master-{self._starts}",
            *clock,
            "/usr/bin/rosmaster",
            "--core",
            environment=environment,
        )
        self.programs.wait_until(self._master_answers, "the master does not answer")
        scenario = self._write_scenario(name, start_m, self.setup.fault)
        hull = [*clock, sys.executable, "-m", "safety.nodes.hull", "--scenario", str(scenario)]
        hull += ["--time", "wall", "--tether", "1.0"]
        if self.setup.apads > 1:
            for name in self.names:
                words = ["--direct", "--apad", name, "--orders", str(self._socket(name))]
                self._start(name, *hull, *words, environment=environment)
            for name in self.names:
                self._wait_ready(name)
                if self.setup.watchdog:
                    self.start_watchdog(apad=name)
            return
        if self.is_counterpart:
            self._start("hull", *clock, *self._counterpart(start_m), environment={})
        else:
            self._start("hull", *hull, "--orders", str(self._socket("hull")), environment=environment)
        self._wait_ready("hull")
        workspace = environment | self._workspace(environment["PYTHONPATH"])
        self._start("relay", *clock, *self._node("relay"), environment=workspace)
        self._wait_ready("relay")
        if self.setup.watchdog:
            self.start_watchdog(*clock, environment=workspace)

    def _counterpart(self, start_m: Place) -> list[str]:
        place, flow = ([f"{it:g}" for it in pair] for pair in (start_m, self.setup.current_m_s))
        words = ["/usr/bin/python3", str(COUNTERPART), "--namespace", "/apad1", "--truth", TRUTH]
        words += ["--start", *place, "--current", *flow, "--seed", str(self.rng.randrange(2**31))]
        words += ["--idle-hours", f"{IDLE_HOURS:g}"]
        return [*words, f"/apad1/position:={HULL}", "/apad1/battery_level:=/hull/battery_level"]

    def start_watchdog(
        self, *clock: str, environment: dict[str, str] | None = None, apad: str = "apad1"
    ) -> None:
        version = self.setup.watchdog_python
        python = older_python(version) if version else "/usr/bin/python3"
        words = [*clock, python, str(ROOT / "launch_scripts" / "vehicle_watchdog"), "--apad"]
        words += [f"/{apad}", "--silence-s", f"{self.setup.silence_s:g}"]
        if self.setup.apads > 1:
            words += ["--heartbeat", f"/musselbed/{apad}/heartbeat"]
        name = "watchdog" if self.setup.apads == 1 else f"watchdog-{apad}"
        self._start(name, *words, environment=environment or self._workspace(PATH))

    def actor(self, name: str, *words: str) -> None:
        """Another node on the vehicle's computer: `stranger`, `caller`, or a second `relay`."""
        script = "relay" if name == "second" else name
        environment = self._workspace(PATH)
        self._start(name, *self._node(script, name), *words, environment=environment)
        self._wait_ready(name)

    def _node(self, script: str, name: str = "") -> list[str]:
        name = name or script
        return [
            "/usr/bin/python3",
            str(NODES / f"{script}.py"),
            f"actor_{name}",
            str(self._socket(name)),
        ]

    def _socket(self, name: str) -> Path:
        return self.home / f"{name}-{self._starts}.sock"

    def _workspace(self, before: str) -> dict[str, str]:
        """The environment of a shell in the vehicle's workspace."""
        messages = str(Path(sys.prefix) / "share" / "musselbed" / "ros")
        return {"PYTHONPATH": f"{before}:{messages}", "ROS_PACKAGE_PATH": messages}

    def _start(self, name: str, *words: str, environment: dict[str, str]) -> None:
        self._processes[name] = self.programs.start(
            self.vehicle, f"{name}-{self._starts}", *words, environment=environment
        )

    def _wait_ready(self, name: str) -> None:
        self._wait_for(name, f"{name}-{self._starts}", "ready")

    def _wait_for(self, name: str, log: str, word: str) -> None:
        """Until the program says so; NoFlight when it ends before."""
        process = self._processes[name]
        self.programs.wait_until(
            lambda: word in self.programs.said(log) or process.poll() is not None, f"{name} does not start"
        )
        if process.poll() is not None:
            raise NoFlight(f"{name} ended: {self.programs.said(log)[-500:]}")

    def _master_answers(self) -> bool:
        connect = f"import socket; socket.create_connection(({self.vehicle.address!r}, 11311), 1).close()"
        return (
            subprocess.run(
                self.vehicle.command(sys.executable, "-c", connect), stderr=subprocess.DEVNULL
            ).returncode
            == 0
        )

    def _fly(self) -> None:
        """Starts the bench; what its preflight holds against a machine like this one is overridden by name."""
        for number in range(4):
            process = self._start_run(number)
            with suppress(TimeoutError):
                if self.setup.flies == "calls":
                    self._call_for_ways()
                self.wait(lambda: self._has_begun() or self.run_ended(), BEGIN_S, "")
            if process.poll() is None and self._has_begun():
                return
            red = self._red()
            if process.poll() is None or not red or set(red) <= set(self.despite):
                break
            self.despite += [it for it in red if it not in self.despite]
        raise NoFlight(self.programs.said(f"run-{number}")[-1500:])

    def _has_begun(self) -> bool:
        if self.setup.rests or self.setup.amussels:
            return all(map(self.orders, self.names))
        return all(map(self.is_under_way, self.names))

    def _start_run(self, number: int) -> subprocess.Popen[bytes]:
        self.run = self.programs.folder(self.bench) / f"run-{number}"
        process = self._processes["run"] = self.start_bench(self.run)
        return process

    def start_bench(self, directory: Path) -> subprocess.Popen[bytes]:
        """A command of the laptop that flies the vehicle, whose records are in `directory`."""
        match self.setup.flies:
            case "script":
                (self.home / "ways.py").write_text(_WAYS)
                words = ["script", str(self.home / "ways.py"), "--scenario", str(self.scenario)]
            case "calls":
                words = ["run", str(self.scenario), "--manual"]
            case _:
                words = ["run", str(self.scenario)]
        own = ["--generation", self.generation, "--on-supervisor-death", "resume", "--speed", "1"]
        words += own if self.setup.is_our_own else ["--apad", "ros"]
        words += ["--out", str(directory), *self.setup.run_words]
        words += [word for it in self.despite for word in it.split()]
        return self._on_laptop(directory.name, *words)

    def _on_laptop(self, name: str, *words: str) -> subprocess.Popen[bytes]:
        self.runs.append(name)
        return self.programs.start(self.bench, name, *MUSSELBED, *words)

    def resume(self, directory: Path | None = None) -> float:
        """Another supervisor continues the run, or its copy in `directory`; returns when it takes orders.

        A vehicle in rospy may hear a new node only a minute after a cut: a person tries again.
        """
        self.run = directory or self.run
        if not any(self._is_resumed() for _ in range(RESUMES)):
            raise NoFlight(f"it is not resumed: {self.programs.said(self.runs[-1])[-800:]}")
        return time.monotonic()

    def _is_resumed(self) -> bool:
        process = self._on_laptop(f"resume-{len(self.runs)}", "resume", str(self.run), "--confirm-motion")
        self._processes["run"] = process
        self.wait(lambda: self.takes_orders() or process.poll() is not None, PATIENCE_S, "it is not resumed")
        return process.poll() is None

    def takes_orders(self) -> bool:
        """The run has a supervisor that listens."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as link, suppress(OSError):
            link.connect(str(self.run / "control.sock"))
            return True
        return False

    def said_by_bench(self) -> str:
        """All that the commands which fly have printed."""
        return "\n".join(self.programs.said(it) for it in self.runs)

    def _call_for_ways(self) -> None:
        if "caller" not in self._processes:
            self.actor("caller")
        self.call("go_to_point", places=_ENDS, every_s=CALL_S)

    def _red(self) -> list[str]:
        """The checks on which the preflight stood, each as the option with which a person decides otherwise."""
        said = self.programs.said(self.run.name)
        options = {"FAIL": "--despite", "CANNOT TELL": "--accept"}
        found = re.findall(r"^(FAIL|CANNOT TELL) +(?:/\S+ )?([a-z][a-z-]*):", said, re.M)
        return [
            f"{options[state]} {check}"
            for state, check in dict.fromkeys(found)
            if check not in NEVER_OVERRIDDEN
        ]

    def _write_scenario(self, name: str, start_m: Place, fault: str | None = None) -> Path:
        """The shipped scenario in our square; the bench is not told of a `fault` of the hull."""
        data = yaml.safe_load(SCENARIO.read_text())
        corners = [list(it) for it in FENCE]
        data["area"] |= {"polygon_m": corners, "fence": corners, "home_m": list(START_M)}
        count = self.setup.amussels or len(self._corners())
        data["fleet"] |= {"count": count, "start": str(self.home / "fleet.csv")}
        data["apad"] |= {
            "start_m": list(start_m),
            "generation": self.generation,
            "drift_m_s": list(self.setup.current_m_s),
            "battery": {"capacity_wh": BATTERY_WH},
        }
        if self.setup.apads > 1:
            data["apad"]["start_m"] = [start_m[0], LANES_M[0]]
            data["apads"] = [
                {"name": name, "start_m": [start_m[0], east_m]}
                for name, east_m in zip(self.names[1:], LANES_M[1:], strict=True)
            ]
        if fault is not None:
            data["apad"]["fault"] = fault
        data["guards"] |= self.setup.guards
        if self.setup.arm_moves:
            data["mission"]["docking"]["arm"] = "moved"
        if self.setup.docks_by_eye:
            data["mission"]["docking"] = yaml.safe_load(BY_EYE.read_text())["mission"]["docking"]
        data["duration_s"] = self.duration_s
        if self.setup.rests:
            data["theta"] = 1
        if self.setup.amussels:
            data["mission"]["full_threshold"] = SHORT_CHARGE
        path = self.home / f"{name}.yaml"
        path.write_text(yaml.safe_dump(data, sort_keys=False))
        return path

    def _corners(self) -> tuple[Place, ...]:
        if self.setup.apads == 1:
            return CORNERS
        return tuple((north_m, east_m) for east_m in LANES_M[: self.setup.apads] for north_m in LANE_ENDS_M)

    def _write_fleet(self) -> None:
        places = [
            (n + self.rng.uniform(-SHIFT_M, SHIFT_M), e + self.rng.uniform(-SHIFT_M, SHIFT_M))
            for n, e in self._corners()
        ]
        if self.setup.near_m is not None:
            angle = self.rng.uniform(0, 2 * math.pi)
            near = self.setup.near_m
            places[0] = (START_M[0] + near * math.cos(angle), START_M[1] + near * math.sin(angle))
        if self.setup.amussels:
            inner_m = (SHORE_M, SIDE_M - SHORE_M)
            places = [
                (self.rng.uniform(*inner_m), self.rng.uniform(*inner_m)) for _ in range(self.setup.amussels)
            ]
        charge = 1.0 if self.setup.rests else LOW if self.setup.amussels else 0.5
        rows = [f"{number},{n:.3f},{e:.3f},{charge}" for number, (n, e) in enumerate(places, 1)]
        (self.home / "fleet.csv").write_text("\n".join(["id,north,east,battery", *rows]) + "\n")

    def _mount_small_disk(self) -> None:
        folder = self.programs.folder(self.bench)
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=48m", "tmpfs", str(folder)], check=True)
        self.stack.callback(subprocess.run, ["umount", "-l", str(folder)], check=False)

    # What is done to it.

    def falsify(self, kind: str, who: str = "relay", **how: Any) -> None:
        self._send(who, {"position": {"kind": kind, **how}})

    def tell_battery(self, **how: Any) -> None:
        self._send("relay", {"battery": how})

    def stranger(self, do: str, **how: Any) -> None:
        self._send("stranger", {"do": do, **how})

    def _send(self, who: str, order: dict[str, Any]) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as out:
            out.sendto(json.dumps(order).encode(), str(self.home / f"{who}-{self._starts}.sock"))

    def kill(self, *names: str) -> None:
        """Programs of the vehicle's computer, as when their process is killed."""
        for name in names:
            with suppress(ProcessLookupError):
                os.killpg(self._processes[name].pid, signal.SIGKILL)
            self._processes[name].wait()

    def cut_power(self, off_s: float) -> None:
        """The vehicle's computer dies, and starts again where the hull is then."""
        here = self.place()
        self.kill("watchdog", "relay", "stranger", "hull", "master")
        self.pause(off_s)
        self.boot("after", here)

    def spoil(self, who: str = "hull", **how: Any) -> None:
        """A fault of our hull, or of its services (`nodes/hull.py`); `who` is the aPad, where there are several."""
        self._send(who, how)

    def signal_vehicle(self, number: int, name: str) -> None:
        """A program of the vehicle's computer, with all of its processes."""
        os.killpg(self._processes[name].pid, number)

    def signal_bench(self, number: int, *words: str) -> None:
        """All processes of the laptop, or those with one of the words in their command line."""
        found = self.processes(*words)
        if not found:
            raise NoFlight(f"no process of {' or '.join(words)} on the laptop")
        for pid in found:
            with suppress(ProcessLookupError):
                os.kill(pid, number)

    def _end_laptop(self) -> None:
        """Ends what is left there: a process that stands still, or whose parent was killed, ends by nothing else."""
        for pid in self.processes():
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)

    def processes(self, *words: str) -> list[int]:
        """Pids in the laptop's network namespace, but for the one that keeps it."""
        keeper = self.bench._keeper
        network = os.readlink(f"/proc/{keeper}/ns/net")
        found = []
        for entry in Path("/proc").iterdir():
            if not entry.name.isdigit() or int(entry.name) == keeper:
                continue
            with suppress(OSError):
                line = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
                is_there = os.readlink(entry / "ns" / "net") == network
                if is_there and (not words or any(it in line for it in words)):
                    found.append(int(entry.name))
        return found

    def draw_fence(self, corners: tuple[Place, ...]) -> None:
        """Somebody edits the scenario in the run's records."""
        path = self.run / "scenario.yaml"
        data = yaml.safe_load(path.read_text())
        data["area"]["fence"] = [list(it) for it in corners]
        path.write_text(yaml.safe_dump(data, sort_keys=False))

    def fill_disk(self) -> None:
        with suppress(OSError), (self.programs.folder(self.bench) / "filling").open("wb") as out:
            while True:
                out.write(bytes(2**16))
                out.flush()

    def call(self, name: str, **request: Any) -> None:
        """A call of the bench's own service, whose answer `answers` has later."""
        if "caller" not in self._processes:
            self.actor("caller")
        self._send("caller", {"call": name, **request})

    def answers(self, name: str) -> list[dict[str, Any]]:
        """The answers to calls of this service until now."""
        lines = self.programs.said(f"caller-{self._starts}").splitlines()
        said = [json.loads(it) for it in lines if it.startswith("{") and it.endswith("}")]
        return [it for it in said if it["call"] == name]

    def called(self, name: str, **request: Any) -> dict[str, Any]:
        """Calls it, and returns its answer."""
        before = len(self.answers(name)) if "caller" in self._processes else 0
        self.call(name, **request)
        self.wait(lambda: len(self.answers(name)) > before, ANSWER_S, f"{name} does not answer")
        return self.answers(name)[before]

    # A person.

    def person(self, *words: str, one: str = "") -> Pressed:
        """`musselbed WORDS[0] RUN WORDS[1:]` on the laptop, which waits to be pressed. `one`: RUN is that aPad's."""
        command = self.bench.command(
            sys.executable, "-c", COMMAND, "musselbed", words[0], str(self.run / one), *words[1:]
        )
        return self._waiting(words, command)

    def order_by_console(self, act: str) -> Pressed:
        """The order that the live page's button gives, which waits to be pressed."""
        found = re.search(r"(http://127\.0\.0\.1:\d+)/\?token=(\S+)", self.programs.said(self.run.name))
        if found is None:
            raise NoFlight("the run printed no address of its console")
        command = self.bench.command(sys.executable, "-c", PAGE, *found.groups(), act)
        return self._waiting(("console", act), command)

    def order_by_imc(self, *place_deg: float) -> Pressed:
        """The stop of an IMC console at IMC_PORT, or its plan to go to a place, which waits to be pressed."""
        words = [sys.executable, str(NODES / "imc_order.py"), str(IMC_PORT), *map(str, place_deg)]
        return self._waiting(("imc", "go to" if place_deg else "stop"), self.bench.command(*words))

    def _waiting(self, words: tuple[str, ...], command: list[str]) -> Pressed:
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=self.bench.environment(self.programs.uri) | {"ROS_HOME": str(self.home / "ros")},
            cwd=ROOT,
        )
        self.stack.callback(_end, process)
        assert process.stdout is not None
        if process.stdout.readline().strip() != "warm":
            raise NoFlight(f"{' '.join(words)} cannot be loaded")
        return Pressed(words, process)

    # The wire.

    def look(self, apad: str = "apad1") -> list[Fact]:
        """All facts of this aPad until now."""
        if self._processes["wire"].poll() is not None:
            raise NoFlight(f"the observer ended: {self.programs.said('wire')[-300:]}")
        with (self.home / "wire.out").open("rb") as said:
            said.seek(self._read_bytes)
            new = said.read()
        whole = new[: new.rfind(b"\n") + 1]
        self._read_bytes += len(whole)
        self.facts += [json.loads(it) for it in whole.splitlines() if it.startswith(b"{")]
        return [it for it in self.facts if it["apad"] == f"/{apad}"]

    def place(self) -> Place:
        last = next(it for it in reversed(self.look()) if it["fact"] == "truth")
        return last["north"], last["east"]

    def orders(self, apad: str = "apad1") -> list[Fact]:
        """The bench's orders until now."""
        return [
            it
            for it in self.look(apad)
            if it["fact"] in ("call", "goal") and it["by"].startswith("/musselbed")
        ]

    def ordered(self, order: str) -> bool:
        """The bench has called this service of the vehicle."""
        return any(it.get("order") == order for it in self.orders())

    def is_under_way(self, apad: str) -> bool:
        """The bench's newest order is a way, and a good part of it lies ahead."""
        orders = self.orders(apad)
        places = [(it["north"], it["east"]) for it in self.look(apad) if it["fact"] == "truth"]
        if not orders or not places or orders[-1].get("place") is None:
            return False
        gone_m, ahead_m = (math.dist(places[-1], it) for it in (places[0], orders[-1]["place"]))
        return gone_m > UNDER_WAY_M and ahead_m > self.setup.ahead_m

    def arm_is_open(self) -> bool:
        """The bench has opened an arm, and not closed it yet."""
        arms = [it["open"] for it in self.look() if it["fact"] == "arms" and "/musselbed" in it["by"]]
        return bool(arms) and arms[-1] >= 0

    def is_docking(self) -> bool:
        """The vehicle is where it was sent, and the bench has ordered what comes after a way."""
        orders = [
            it
            for it in self.orders()
            if "goal" in it["fact"] or it["order"].startswith("commander/primitive")
        ]
        return len(orders) > 1 and (
            orders[-1].get("kind") == PERCH or "dynamic" in orders[-1].get("order", "")
        )

    def wait(self, is_so: Callable[[], bool], patience_s: float, failure: str) -> None:
        until_s = time.monotonic() + patience_s
        while not is_so():
            if time.monotonic() > until_s:
                raise TimeoutError(failure)
            self.pause(0.2)

    def pause(self, seconds: float) -> None:
        """Lets time pass; NoFlight when the campaign ends."""
        if self.ended.wait(seconds):
            raise NoFlight("the campaign was ended")

    def guards(self) -> list[str]:
        """The guards' stops that the run itself confesses in its journal."""
        found = []
        for line in (self.run / "journal.jsonl").read_text().splitlines():
            with suppress(json.JSONDecodeError):  # the last one may not be whole yet
                it = json.loads(line)
                if it.get("kind") == "guard" or (it.get("kind") == "stop" and it["by"].startswith("guard")):
                    found.append(
                        f"{it['kind']} {it.get('by', '')} {it.get('cause', '')} {it.get('reason', '')}"
                    )
        return list(dict.fromkeys(found))

    def run_ended(self) -> bool:
        return self._processes["run"].poll() is not None


MUSSELBED = [sys.executable, "-m", "apad_bridge.commands.main"]


def _end(process: subprocess.Popen[str]) -> None:
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        with suppress(OSError, ValueError):
            assert pipe is not None
            pipe.close()
