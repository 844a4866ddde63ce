"""Process tests: the console against a tiny fake system.

The fake system has its own small packer and its own CRC. It does not use the
codec of the console.
"""

import json
import queue
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

CONSOLE = str(Path(__file__).resolve().parent.parent / "console.py")
ME = 0x2A00
WAIT = 10.0


def crc(data):
    """CRC-16-IBM bit by bit."""
    register = 0
    for octet in data:
        register ^= octet
        for _ in range(8):
            register = (register >> 1) ^ (0xA001 if register & 1 else 0)
    return register


def text(value):
    value = value.encode()
    return struct.pack(">H", len(value)) + value


def pack(number, payload=b"", src=ME, dst=0xFFFF):
    body = struct.pack(">HHHdHBHB", 0xFE54, number, len(payload), time.time(), src, 0, dst, 255) + payload
    return body + struct.pack(">H", crc(body))


class Fake:
    """A system with one socket."""

    def __init__(self):
        self.sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.sock.bind(("127.0.0.1", 0))
        self.sock.settimeout(0.05)
        self.port = self.sock.getsockname()[1]
        self.console = None

    def announce(self, lat=0.75, lon=0.25, name="aPad", src=ME, services=None):
        services = f"imc+udp://127.0.0.1:{self.port}/;" if services is None else services
        return pack(151, text(name) + struct.pack(">BHddf", 3, 0xFFFF, lat, lon, 0.0) + text(services), src)

    def send(self, data):
        self.sock.sendto(data, self.console)

    def get(self, number, seconds=WAIT, order=">"):
        """Return (header, payload, source) of the next message of an id."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            try:
                data, source = self.sock.recvfrom(65535)
            except TimeoutError:
                continue
            header = struct.unpack(order + "HHHdHBHB", data[:20])
            assert header[0] == 0xFE54 and len(data) == 22 + header[2]
            if header[1] == number:
                good = crc(data[:-2]) == struct.unpack(order + "H", data[-2:])[0]
                return header, data[20:-2], source, good
        return None

    def drain(self):
        """Throw away what is waiting. Return the number of datagrams."""
        count = 0
        self.sock.setblocking(False)
        try:
            while True:
                self.sock.recvfrom(65535)
                count += 1
        except BlockingIOError:
            pass
        self.sock.settimeout(0.05)
        return count


class Driver:
    """Starts a console and talks with it."""

    def __init__(self, fake, *extra):
        self.process = subprocess.Popen(
            [
                sys.executable,
                CONSOLE,
                "--port",
                "0",
                "--discovery-port",
                "0",
                "--announce-to",
                f"127.0.0.1:{fake.port}",
                *extra,
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        self.lines = queue.Queue()
        self.kept = []
        threading.Thread(target=self._read, daemon=True).start()
        self.ready = self.event("ready")
        fake.console = tuple(self.ready["udp"])

    def _read(self):
        for line in self.process.stdout:
            self.lines.put(json.loads(line))

    def find(self, test, seconds=WAIT):
        end = time.monotonic() + seconds
        for index, record in enumerate(self.kept):
            if test(record):
                return self.kept.pop(index)
        while time.monotonic() < end:
            try:
                record = self.lines.get(timeout=0.05)
            except queue.Empty:
                continue
            if test(record):
                return record
            self.kept.append(record)
        return None

    def event(self, kind, seconds=WAIT, **values):
        found = self.find(
            lambda record: (
                record.get("event") == kind and all(record.get(key) == value for key, value in values.items())
            ),
            seconds,
        )
        if seconds == WAIT:
            assert found is not None, (kind, values, self.kept)
        return found

    def ask(self, line):
        self.process.stdin.write(line + "\n")
        answer = self.find(lambda record: "answer" in record)
        assert answer is not None and answer["answer"] == (line.split() or [""])[0], answer
        return answer

    def close(self):
        if self.process.poll() is None:
            try:
                self.process.stdin.write("quit\n")
                self.process.stdin.close()
                self.process.wait(5)
            except (OSError, ValueError, subprocess.TimeoutExpired):
                self.process.kill()
                self.process.wait(5)


@pytest.fixture
def start():
    made = []

    def run(*extra, announce=True):
        fake = Fake()
        made.append(fake.sock)
        driver = Driver(fake, *extra)
        made.append(driver)
        if announce:
            fake.send(fake.announce())
            driver.event("system", system="aPad")
        return fake, driver

    yield run
    for item in reversed(made):
        item.close()


def plan_control(kind, op, request, plan="", dst=0x4001, src=ME):
    return pack(
        559,
        struct.pack(">BBH", kind, op, request) + text(plan) + struct.pack(">HH", 0, 0xFFFF) + text("because"),
        src,
        dst,
    )


def test_discovery_heartbeat_and_silence(start):
    fake, driver = start("--vehicle", "aPad", announce=False)
    header, payload, source, good = fake.get(151)
    assert good and header[4] == 0x4001 and header[6] == 0xFFFF
    assert payload.startswith(text("ccu-console-0-1") + b"\x00\xff\xff")
    assert payload.endswith(text(f"imc+udp://127.0.0.1:{fake.console[1]}/;"))
    assert source == tuple(driver.ready["discovery"])
    fake.sock.sendto(fake.announce(), tuple(driver.ready["discovery"]))
    system = driver.event("system", system="aPad")
    assert system["type_name"] == "USV" and system["on_map"] and system["address"] == ["127.0.0.1", fake.port]
    assert system["lat_deg"] == pytest.approx(42.9718, abs=1e-3)
    # The query of entities comes at once and with every Announce.
    header, payload, _, _ = fake.get(5)
    assert header[6] == ME and payload == b"\x01\x00\x00"
    fake.send(fake.announce())
    assert fake.get(5)
    fake.send(pack(5, b"\x00" + text("Daemon=0;Battery=3"), dst=0x4001))
    assert driver.event("entities")["entities"] == {"Daemon": "0", "Battery": "3"}
    fake.send(fake.announce())
    assert fake.get(5, 0.5) is None
    beats = []
    for _ in range(3):
        header, _, source, _ = fake.get(150)
        assert header[6] == ME and source == fake.console
        beats.append(time.monotonic())
    assert 1.6 < beats[2] - beats[0] < 2.6
    silent = driver.event("silent", system="aPad")
    assert 2.0 <= silent["silent_for_s"] < 2.6
    assert driver.ask("systems")["systems"][0]["active"] is False
    fake.send(pack(150))
    driver.event("active", system="aPad")
    # silence stops the heartbeats, heartbeat starts them again.
    assert driver.ask("silence") == {"answer": "silence", "n": 2, "ok": True, "heartbeats": False}
    fake.drain()
    assert fake.get(150, 1.5) is None
    assert driver.ask("heartbeat")["ok"]
    assert fake.get(150)


def test_states_and_modes(start):
    fake, driver = start()
    fake.send(
        pack(
            350,
            struct.pack(
                ">dd18f", 0.75, 0.25, 0, 100, 0, 0, 0, 0, 1.5707964, 1, 0, 0, 0, 2, 0, 0, 0, 0, 0.5, 3
            ),
        )
    )
    state = driver.event("state")
    assert state["lat_deg"] > 42.9718 and state["heading_deg"] == pytest.approx(90)
    assert state["speed_mps"] == 2.0 and state["depth_m"] == 0.5
    vehicle = (
        struct.pack(">BB", 3, 0) + text("") + struct.pack(">HdHIB", 450, 0, 0, 0, 0) + text("") + bytes(8)
    )
    fake.send(pack(500, b"\0" + vehicle[1:]))
    assert driver.event("mode")["mode"] == "SERVICE"
    fake.send(pack(500, vehicle))
    mode = driver.event("mode")
    assert (mode["mode"], mode["was"], mode["maneuver"]) == ("MANEUVER", "SERVICE", "Goto")
    fake.send(pack(500, vehicle))
    fake.send(pack(279, struct.pack(">ff", 50, 90) + text("")))
    assert driver.event("message", message="FuelLevel")["fields"]["value"] == 50
    assert driver.event("mode", 0.1) is None
    answer = driver.ask("state 0x2a00")
    assert answer["mode"] == "MANEUVER" and answer["last"]["FuelLevel"]["0"]["fields"]["confidence"] == 90
    fake.send(pack(600, struct.pack(">7d", 0.7, 0.2, 0, 0, 0, 0, 0) + text("aMussel-1") + b"\x03"))
    assert driver.event("external")["new"] is True
    assert driver.ask("systems")["external"][0]["name"] == "aMussel-1"


def test_goto_replies_and_waypoint(start):
    fake, driver = start()
    answer = driver.ask("goto aPad 43.1 14.2 1.5")
    assert answer["ok"] and answer["request_id"] == 1
    header, payload, _, good = fake.get(559)
    assert good and header[6] == ME and payload[:4] == b"\0\0\0\x01"
    plan = payload[4:][2 : 2 + struct.unpack(">H", payload[4:6])[0]].decode()
    assert plan == answer["plan_id"]
    arg = payload[6 + len(plan) + 2 : -2]
    assert struct.unpack(">H", arg[:2])[0] == 551
    # The Goto within: timeout, lat, lon, z, DEPTH, speed, m/s.
    goto = struct.pack(
        ">HHddfBfB", 450, 1000, 43.1 * 3.141592653589793 / 180, 14.2 * 3.141592653589793 / 180, 0.0, 1, 1.5, 0
    )
    assert goto in arg
    fake.send(plan_control(3, 0, 1, plan))
    reply = driver.event("reply")
    assert reply["matched"] and reply["result"] == "IN_PROGRESS" and reply["info"] == "because"
    fake.send(plan_control(1, 0, 1, plan))
    reply = driver.event("reply")
    assert reply["matched"] and reply["result"] == "SUCCESS" and reply["problems"] == []
    for bad, why in (
        (plan_control(1, 0, 1, plan), "already answered"),
        (plan_control(1, 0, 9), "no such request"),
        (plan_control(1, 1, 1, plan), "the request was START"),
        (plan_control(1, 0, 1, plan, dst=0x4002), "not to me"),
        (plan_control(1, 0, 1, plan, src=0x2A07), "the request went to another system"),
    ):
        fake.send(bad)
        assert driver.event("reply")["reason"] == why
    # The console asks for the plan that runs and then shows the waypoint.
    fake.send(
        pack(
            560,
            b"\x03"
            + text(plan)
            + struct.pack(">if", 10, 0.0)
            + text("Goto1")
            + struct.pack(">HiB", 450, 10, 0),
        )
    )
    assert driver.event("mode")["mode"] == "EXECUTING"
    asked = driver.event("asked")
    _, payload, _, _ = fake.get(556)
    assert payload[:4] == struct.pack(">BBH", 0, 2, asked["request_id"])
    fake.send(
        pack(556, struct.pack(">BBH", 1, 2, asked["request_id"]) + text(plan) + arg + text(""), dst=0x4001)
    )
    waypoint = driver.event("waypoint")["waypoint"]
    assert waypoint["lat_deg"] == pytest.approx(43.1) and waypoint["man_id"] == "Goto1"


def test_goto_by_plandb_and_default_speed(start):
    fake, driver = start()
    answer = driver.ask("goto aPad 43 14 via=plandb plan=p1")
    assert [item["fate"] for item in answer["requests"]] == ["sent", "waits"]
    _, payload, _, _ = fake.get(556)
    assert payload[:4] == b"\0\0\0\x01"
    assert struct.pack(">fB", 1000.0, 1) in payload
    assert fake.get(559, 0.3) is None
    fake.send(pack(556, struct.pack(">BBH", 1, 0, 1) + text("p1") + b"\xff\xff" + text(""), dst=0x4001))
    _, payload, _, _ = fake.get(559)
    assert payload == b"\0\0\0\x02" + text("p1") + b"\0\0\xff\xff\0\0"
    assert driver.event("sent")["request_id"] == 2
    assert driver.ask("state aPad")["plans"] == ["p1"]


def test_other_orders(start):
    fake, driver = start("--reply-timeout", "0.5")
    assert driver.ask("start aPad survey flags=1")["request_id"] == 1
    assert fake.get(559)[1] == b"\0\0\0\x01" + text("survey") + b"\0\x01\xff\xff\0\0"
    assert driver.ask("stop aPad")["request_id"] == 2
    assert fake.get(559)[1] == b"\0\x01\0\x02" + text("") + b"\0\0\xff\xff\0\0"
    assert driver.event("no_reply", request_id=1)["op"] == "START"
    fake.send(plan_control(2, 0, 1, "survey"))
    late = driver.event("reply")
    assert late["late"] and late["result"] == "FAILURE"
    assert driver.ask("abort aPad")["ok"]
    assert fake.get(550)[0][6] == ME
    assert driver.ask("keep aPad 43 14 1 radius=20 duration=60 via=bare")["ok"]
    payload = fake.get(461)[1]
    assert payload[16:] == struct.pack(">fBfHfB", 0, 1, 20, 60, 1, 0) + b"\0\0"
    assert driver.ask("goto aPad 43 14 50 % via=vehicle")["ok"]
    assert fake.get(501)[1][:4] == b"\0\0\x03\0"
    assert driver.ask("upload aPad two 43 14 43.1 14.1 speed=1")["ok"]
    payload = fake.get(556)[1]
    assert text("Goto1") + text("Goto2") + text("ManeuverIsDone") in payload
    assert driver.ask("plandb aPad get_dstate")["ok"]
    assert fake.get(556)[1][1] == 6
    assert driver.ask("teleop aPad on")["ok"]
    assert text("src=16385") in fake.get(559)[1]
    assert driver.ask("remote aPad Thrust=0.5 Heading=0")["ok"]
    assert fake.get(305)[1] == text("Thrust=0.5;Heading=0")
    assert driver.ask("teleop aPad off")["ok"] and fake.get(460)
    assert driver.ask('send aPad EntityState {"state": "FAULT", "description": "a b"}')["ok"]
    assert fake.get(1)[1] == b"\x02\0" + text("a b")
    first = driver.ask("resend 1")
    assert first["ok"] and fake.get(559)[1][:4] == b"\0\0\0\x01"
    assert driver.ask("raw 0102ff aPad")["length"] == 3
    data = b""
    while data != b"\x01\x02\xff":
        data = fake.sock.recvfrom(100)[0]


def test_bad_commands_get_one_answer_each(start):
    _, driver = start("--vehicle", "other")
    lines = [
        "",
        "nothing",
        "goto",
        "goto aPad 43 14 1",
        "goto nobody 43 14",
        "abort",
        "raw zz",
        "raw",
        "state x",
        "send aPad Goto {",
        'send aPad Goto {"lat": [1]}',
        'send aPad PlanControl {"arg": 3}',
        'send aPad PlanControl {"op": [1]}',
        'send aPad LogBookControl {"msg": 4}',
        "send aPad Goto [1]",
        "send aPad Nope",
        "wait -1",
        "goto 'aPad",
        "resend 77",
        "announce maybe",
    ]
    for number, line in enumerate(lines, 1):
        answer = driver.ask(line)
        assert answer["ok"] is False and answer["n"] == number and answer["error"], line
    assert len(driver.ask("help")["commands"]) > 20
    assert driver.find(lambda record: "answer" in record, 0.3) is None


def test_bad_datagrams(start):
    fake, driver = start()
    good = pack(150)
    for data, why in (
        (b"\xfe\x54\0", "short"),
        (good[:-1], "short"),
        (b"\1\2" + good[2:], "bad sync"),
        (good[:-1] + bytes([good[-1] ^ 255]), "bad CRC"),
        (pack(150, b"x"), "bad payload"),
        (good + b"xyz", "trailing bytes"),
        (pack(4242), "unknown id"),
        (b"", "short"),
    ):
        fake.send(data)
        bad = driver.event("bad_datagram")
        assert bad["reason"] == why and bad["from"] == ["127.0.0.1", fake.port] and bad["length"] == len(data)
    fake.send(pack(150, src=0x4001))
    driver.event("conflict")
    fake.send(fake.announce(lat=43.0, lon=14.0, src=0x2801, name="aPad"))
    whats = {driver.event("warning")["what"] for _ in range(4)}
    assert whats == {
        "ghost id",
        "another id has the same name",
        "lat is out of range (radians)",
        "lon is out of range (radians)",
    }
    assert "2 ids" in driver.ask("abort aPad")["error"]


def test_unannounced_and_no_service(start):
    fake, driver = start(announce=False)
    fake.send(pack(150))
    assert driver.event("unannounced")["id"] == ME
    assert driver.ask("systems")["systems"][0]["announced"] is False
    fake.send(fake.announce(lat=0.0, services="imc+udp://10.0.0.1:6001/;"))
    assert driver.event("system")["on_map"] is False
    assert driver.event("warning")["what"] == "no imc+udp service on loopback"
    assert "no imc+udp service" in driver.ask("abort aPad")["error"]


def test_swap(start):
    fake, driver = start("--swap")
    assert driver.ask("abort aPad")["ok"]
    header, _, _, good = fake.get(550, order="<")
    assert good and header[6] == ME


def test_drop_and_resend(start):
    fake, driver = start("--drop", "1")
    assert driver.ask("start aPad x")["requests"][0]["fate"] == "dropped"
    time.sleep(1.3)
    assert fake.drain() == 0
    assert driver.ask("stats")["stats"]["dropped"]["PlanControl"] == 1


def test_seeded_drop_is_the_same(start):
    rows = []
    for seed in ("7", "7", "8"):
        _, driver = start("--drop", "0.5", "--seed", seed)
        rows.append([driver.ask("start aPad x")["requests"][0]["fate"] for _ in range(30)])
    assert rows[0] == rows[1] != rows[2]
    assert "sent" in rows[0] and "dropped" in rows[0]


def test_bad_crc_duplicate_delay(start):
    fake, driver = start("--bad-crc", "1", "--duplicate", "1", "--delay", "0.4")
    fake.drain()
    before = time.monotonic()
    fate = driver.ask("abort aPad")["requests"][0]
    assert fate["bad_crc"] and fate["copies"] == 2 and fate["delay_s"] == 0.4
    assert fake.get(550)[3] is False
    assert 0.35 < time.monotonic() - before < 2
    assert fake.get(550, 0.5) and fake.get(550, 0.5) is None


def test_own_services_and_address_choice(start):
    fake, driver = start(
        "--service", "imc+udp://172.17.0.1:6001/", "--service", "imc+udp://127.0.0.1:{port}/"
    )
    payload = fake.get(151)[1]
    assert payload.endswith(text(f"imc+udp://172.17.0.1:6001/;imc+udp://127.0.0.1:{fake.console[1]}/;"))
    assert driver.ask("announce off")["sent"] == []


def test_end_of_input_wait_and_exit_codes():
    done = subprocess.run(
        [sys.executable, CONSOLE, "--port", "0", "--discovery-port", "none", "--announce-to", "127.0.0.1:9"],
        input="wait 0.3\nsystems\nquit",
        capture_output=True,
        text=True,
        timeout=10,
    )
    answers = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 0
    assert [a["answer"] for a in answers if "answer" in a] == ["wait", "systems", "quit"]
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind(("127.0.0.1", 0))
    done = subprocess.run(
        [sys.executable, CONSOLE, "--port", str(sock.getsockname()[1])],
        input="",
        capture_output=True,
        text=True,
        timeout=10,
    )
    sock.close()
    assert done.returncode == 1 and json.loads(done.stdout)["event"] == "fatal"
    done = subprocess.run(
        [sys.executable, CONSOLE, "--announce-to", "10.0.0.1:30100"],
        input="",
        capture_output=True,
        text=True,
        timeout=10,
    )
    assert done.returncode == 2


def test_fuzzed_payloads_do_not_stop_the_console(start):
    import random

    fake, driver = start("--mute", "bad_datagram", "--mute", "message")
    source = random.Random(3)
    numbers = [1, 5, 103, 150, 151, 279, 350, 450, 500, 501, 550, 556, 559, 560, 600, 601]
    for count in range(1500):
        payload = bytes(
            source.choice((0, 0, 0, 1, 255, source.randrange(256))) for _ in range(source.randrange(110))
        )
        number = source.choice(numbers)
        if number == 350:
            payload = bytes(source.choice((127, 255, 0, 240)) for _ in range(88))
        fake.send(pack(number, payload, src=source.choice((ME, ME + 1))))
        if count % 100 == 0:
            time.sleep(0.02)
    assert driver.ask("systems")["ok"] and driver.ask("state 0x2a00")["ok"]
    assert driver.process.poll() is None
