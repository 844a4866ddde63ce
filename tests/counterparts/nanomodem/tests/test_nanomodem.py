"""Tests of nanomodem.py against the published facts, over real pseudo-terminals.

Waits are for events (bytes or lines of truth) with a time-out. That something is NOT said is shown by
what comes next on the same line. Lengths of time come from the emulator's own clock (--truth), or are
lower bounds, so that a busy machine does not fail them.
"""

import json
import os
import queue
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import threading
import time
from pathlib import Path

import pytest

PROGRAM = Path(__file__).resolve().parent.parent / "nanomodem.py"
LIMIT = 30.0  # seconds that any event may take on a busy machine


class Host:
    """What a host program does with a serial port."""

    def __init__(self, path):
        self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
        mode = termios.tcgetattr(self.fd)
        mode[0] = mode[1] = mode[3] = 0
        mode[2] = termios.CS8 | termios.CREAD | termios.CLOCAL
        mode[4] = mode[5] = termios.B9600
        mode[6][termios.VMIN], mode[6][termios.VTIME] = 0, 0
        termios.tcsetattr(self.fd, termios.TCSAFLUSH, mode)
        self.kept = b""

    def write(self, data):
        """Write all at once, as a driver does."""
        assert os.write(self.fd, data) == len(data)

    def read(self, size, limit=LIMIT):
        """Exactly `size` bytes."""
        end = time.monotonic() + limit
        while len(self.kept) < size:
            left = end - time.monotonic()
            assert left > 0 and select.select([self.fd], [], [], left)[0], f"only {self.kept!r}"
            self.kept += os.read(self.fd, 4096)
        got, self.kept = self.kept[:size], self.kept[size:]
        return got

    def expect(self, data):
        """The next bytes are these."""
        assert self.read(len(data)) == data

    def ask(self, command, answer):
        """Write a command and expect an answer."""
        self.write(command)
        self.expect(answer)

    def line(self):
        """One line of plain text, without its CR LF."""
        text = b""
        while not text.endswith(b"\r\n"):
            text += self.read(1)
        return text[:-2]

    def range(self):
        """The answer #RxxxTttttt as (address, t)."""
        found = re.fullmatch(rb"#R(\d{3})T(\d{5})", self.line())
        assert found
        return int(found[1]), int(found[2])

    def close(self):
        """Leave the port."""
        os.close(self.fd)


class Sea:
    """A running emulator, its hosts and its lines of truth."""

    def __init__(self, folder, *arguments):
        self.folder, self.truth, self.hosts = folder, [], {}
        self.process = subprocess.Popen(
            [sys.executable, str(PROGRAM), str(folder), *arguments, "--truth"],
            stdout=subprocess.PIPE,
            text=True,
        )
        self.lines = queue.Queue()
        self.thread = threading.Thread(target=self.pump, daemon=True)
        self.thread.start()
        assert self.lines.get(timeout=LIMIT) == "ready\n"

    def pump(self):
        """Pass lines on from the emulator."""
        for line in self.process.stdout:
            self.lines.put(line)

    def host(self, address):
        """The host of a modem."""
        if address not in self.hosts:
            self.hosts[address] = Host(self.folder / f"modem{address}")
        return self.hosts[address]

    def wait(self, **wanted):
        """The next line of truth with these values."""
        end = time.monotonic() + LIMIT
        while True:
            event = json.loads(self.lines.get(timeout=max(0.01, end - time.monotonic())))
            self.truth.append(event)
            if all(event.get(key) == value for key, value in wanted.items()):
                return event

    def stop(self):
        """End by SIGTERM; the exit code."""
        for host in self.hosts.values():
            host.close()
        self.hosts = {}
        self.process.send_signal(signal.SIGTERM)
        code = self.process.wait(timeout=LIMIT)
        self.thread.join(timeout=LIMIT)
        self.process.stdout.close()
        return code


@pytest.fixture
def sea(tmp_path):
    """Start emulators and end them after the test."""
    started = []

    def start(*arguments):
        started.append(Sea(tmp_path / "line", "--seed", "1", *arguments))
        return started[-1]

    yield start
    for one in started:
        if one.process.poll() is None:
            assert one.stop() == 0


PAIR = ("1:0:0:5", "2:150:0:5")
THREE = (*PAIR, "3:0:150:5")


# The line


def test_links_come_and_go(sea):
    """Links exist at `ready` and are gone after SIGTERM."""
    water = sea(*THREE)
    assert sorted(os.listdir(water.folder)) == ["modem1", "modem2", "modem3"]
    assert all((water.folder / f"modem{n}").is_char_device() for n in (1, 2, 3))
    assert water.stop() == 0
    assert os.listdir(water.folder) == []


def test_link_left_over_is_replaced(sea, tmp_path):
    """A link that a killed run left does not stop the next run."""
    (tmp_path / "line").mkdir()
    (tmp_path / "line" / "modem1").symlink_to("nowhere")
    sea(*PAIR).host(1).ask(b"$W", b"$W\r\n")


def test_raw_at_9600_before_any_termios_call(sea):
    """A host that only opens the port finds raw mode and 9600 baud."""
    water = sea(*PAIR)
    fd = os.open(water.folder / "modem1", os.O_RDWR | os.O_NOCTTY)
    mode = termios.tcgetattr(fd)
    assert mode[4] == mode[5] == termios.B9600
    assert not mode[3] & (termios.ICANON | termios.ECHO | termios.ISIG) and not mode[1] & termios.OPOST
    os.write(fd, b"$W")
    assert select.select([fd], [], [], LIMIT)[0]
    assert os.read(fd, 1) == b"$"
    os.close(fd)


def test_termios_calls_and_reopening(sea):
    """What hosts do with a port leaves the modem working."""
    water = sea(*PAIR)
    for speed in (termios.B9600, termios.B115200, termios.B9600):
        host = Host(water.folder / "modem1")
        mode = termios.tcgetattr(host.fd)
        mode[4] = mode[5] = speed
        mode[2] |= termios.HUPCL
        for when in (termios.TCSANOW, termios.TCSADRAIN, termios.TCSAFLUSH):
            termios.tcsetattr(host.fd, when, mode)
        termios.tcflush(host.fd, termios.TCIOFLUSH)
        termios.tcsendbreak(host.fd, 0)
        host.write(b"$W")
        termios.tcdrain(host.fd)
        host.expect(b"$W\r\n")
        host.close()


def test_pace_of_the_line(sea):
    """An answer of 45 bytes to a command of 2 takes at least 47 bytes' time."""
    host = sea(*PAIR).host(1)
    start = time.monotonic()
    host.write(b"$?")
    assert len(host.line()) == 43
    assert time.monotonic() - start >= 47 * 10 / 9600


# Local commands


def test_status_and_voltage(sea):
    """#AxxxVyyyyyRaaa.bbb.cccBdate, with a voltage that is not 0."""
    host = sea(*PAIR).host(1)
    host.write(b"$?")
    found = re.fullmatch(rb"#A001V(\d{5})R\d{3}\.\d{3}\.\d{3}B\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d", host.line())
    assert found and abs(int(found[1]) * 15 / 65536 - 5) < 0.01


def test_set_address(sea):
    """$Axxx sets the address and a reset keeps it; above 255 is an error."""
    water = sea(*PAIR)
    host = water.host(1)
    host.ask(b"$A077", b"#A077\r\n")
    host.ask(b"$R", b"$R\r\n")
    host.ask(b"$A256", b"E\r\n")
    host.write(b"$?")
    assert host.line().startswith(b"#A077V")
    water.host(2).ask(b"$P077", b"$P077\r\n")
    assert water.host(2).range()[0] == 77


def test_malformed_commands(sea):
    """E, and nothing is sent: the next command is answered next."""
    host = sea(*PAIR).host(1)
    for command in (
        b"$",
        b"$K",
        b"$P00",
        b"$P256",
        b"$Px01",
        b"$B01a",
        b"$B65" + b"a" * 65,
        b"$B05abcd",
        b"$U002",
        b"$A",
        b"$X",
        b"$XQ",
        b"$C",
        b"$B02abT123",
        b"$FT",
        b"$XTX",
        b"$B+5abcde",
        b"$" * 300,
    ):
        host.ask(command, b"E\r\n")
        host.ask(b"$Q", b"$C-\r\n")


def test_pause_inside_a_command(sea):
    """A command whose bytes pause is an error; its end is no command either."""
    host = sea(*PAIR).host(1)
    host.ask(b"$P0", b"E\r\n")
    host.write(b"02")
    host.ask(b"$W", b"$W\r\n")


def test_commands_in_one_write_and_line_ends(sea):
    """Commands need no terminator; bytes between commands are ignored."""
    host = sea(*PAIR).host(1)
    host.write(b"\r\n$Q\r\n$W$XQE")
    host.expect(b"$C-\r\n$W\r\n#XQE\r\n")


def test_settings_answers(sea):
    """$X..., $H, $D and $Q."""
    host = sea(*PAIR).host(1)
    for letters in (b"QE", b"QD", b"FE", b"FD"):
        host.ask(b"$X" + letters, b"#X" + letters + b"\r\n")
    host.write(b"$D")
    assert re.fullmatch(rb"#DID:0x.+-A8.+-A16.+-A24.+-A32.+", host.line())
    host.write(b"$H")
    assert host.line()


def test_timer_answers(sea):
    """$XTE, $XTG, $XTC, $XTD: a letter of state and 14 digits of microseconds."""
    host = sea(*PAIR).host(1)

    def timer(command, letter):
        host.write(command)
        found = re.fullmatch(rb"#XT(.)(\d{14})", host.line())
        assert found and found[1] == letter
        return int(found[2])

    assert timer(b"$XTG", b"D") == 0
    first = timer(b"$XTE", b"E")
    later = timer(b"$XTG", b"E")
    assert later - first > 0.019 * 1e6  # an answer of 19 bytes has passed
    assert timer(b"$XTC", b"E") < later
    timer(b"$XTD", b"D")


def test_noise_and_spectrum(sea):
    """$N after about 1 s, $S after about 2 s with 257 values that may hold any byte."""
    host = sea(*PAIR).host(1)
    start = time.monotonic()
    host.ask(b"$N", b"$N\r\n")
    assert re.fullmatch(rb"#NR\d{6}P\d{6}M\d{6}", host.line()) and time.monotonic() - start >= 0.9
    start = time.monotonic()
    host.ask(b"$S", b"$S\r\n#S00257")
    assert len(struct.unpack("<257H", host.read(514))) == 257 and time.monotonic() - start >= 1.9
    host.expect(b"\r\n")


# Packets


def test_broadcast_and_duration(sea):
    """#Bxxxnn at every other modem, after the packet's length and the way of 150 m."""
    water = sea(*THREE)
    water.host(2), water.host(3)
    for size, seconds in ((2, 0.330), (8, 0.405), (16, 0.505), (32, 0.705), (64, 1.105)):
        data = bytes(range(size))
        water.host(1).ask(b"$B%02d" % size + data, b"$B%02d\r\n" % size)
        for n in (2, 3):
            water.host(n).expect(b"#B001%02d" % size + data + b"\r\n")
        sent, got = water.wait(event="sent"), water.wait(event="received", at=2)
        assert sent["duration"] == pytest.approx(seconds, abs=1e-5)
        assert got["time"] - sent["time"] == pytest.approx(seconds + 0.1, abs=1e-4)


def test_payload_of_any_bytes(sea):
    """CR, LF, # and $ in a payload; bytes that look like a time stay payload."""
    water = sea(*PAIR)
    for data in (b"\r\n", b"$P002#TO\r\nE\r\n\x00\xff\x11\x13", b"abT00000000000000"):
        head = b"%02d" % len(data) + data
        water.host(2)
        water.host(1).ask(b"$U002" + head, b"$U002" + head[:2] + b"\r\n")
        water.host(2).expect(b"#U" + head + b"\r\n")


def test_unicast_only_for_its_address(sea):
    """#U without a source at the address alone; the others stay silent."""
    water = sea(*THREE)
    water.host(2), water.host(3)
    water.host(1).ask(b"$U00202hi", b"$U00202\r\n")
    water.host(2).expect(b"#U02hi\r\n")
    water.host(1).ask(b"$B02yo", b"$B02\r\n")
    water.host(3).expect(b"#B00102yo\r\n")  # the first that 3 says


def test_unicast_with_acknowledgement(sea):
    """#U at the remote modem, then #RxxxTttttt; the time is that of both packets and the way."""
    water = sea(*PAIR)
    water.host(2)
    water.host(1).ask(b"$M00208abcdefgh", b"$M00208\r\n")
    water.host(2).expect(b"#U08abcdefgh\r\n")
    address, t = water.host(1).range()
    assert address == 2 and t * 1500 * 3.125e-5 == pytest.approx(150, abs=0.6)
    sent, got = water.wait(event="sent"), water.wait(event="received", at=1)
    assert 0 <= got["time"] - sent["time"] - (0.405 + 0.105 + 0.2) < 0.05  # the rest: turnaround


@pytest.mark.parametrize("speed", [1500, 1450])
def test_ping(sea, speed):
    """The range from t; the ping and its answer last 0.105 s each."""
    water = sea("1:0:0:5", "2:300:400:5", "--sound-speed", str(speed))
    water.host(1).ask(b"$P002", b"$P002\r\n")
    address, t = water.host(1).range()
    assert address == 2 and t * speed * 3.125e-5 == pytest.approx(500, abs=0.6)
    ping, answer = water.wait(event="sent"), water.wait(event="sent")
    assert ping["duration"] == answer["duration"] == 0.105
    assert 0 <= water.wait(event="received", at=1)["time"] - ping["time"] - (0.21 + 1000 / speed) < 0.05


def test_ping_time_out(sea):
    """#TO (a letter O) after 4 s when nobody answers; then the modem is free again."""
    water = sea(*PAIR)
    host = water.host(1)
    start = time.monotonic()
    host.ask(b"$P009", b"$P009\r\n#TO\r\n")
    assert time.monotonic() - start >= 4
    host.ask(b"$P002", b"$P002\r\n")
    assert host.range()[0] == 2


def test_acknowledgement_time_out_when_all_is_lost(sea):
    """With --loss 1 nothing arrives and the sender says #TO."""
    water = sea(*PAIR, "--loss", "1")
    water.host(1).ask(b"$M00202hi", b"$M00202\r\n#TO\r\n")
    assert water.wait(event="lost")["why"] == "loss"


def test_ping_to_oneself(sea):
    """E at once."""
    host = sea(*PAIR).host(1)
    host.ask(b"$P001", b"E\r\n")


def test_voltage_of_a_remote_modem(sea):
    """#Bxxx27V...R...P...M..."""
    host = sea(*PAIR).host(1)
    host.ask(b"$V002", b"$V002\r\n")
    found = re.fullmatch(rb"#B00227V(\d{5})R\d{6}P\d{6}M\d{6}", host.line())
    assert found and int(found[1]) > 0


def test_test_echo_and_beacon(sea):
    """$T brings 64 bytes of text, $E the payload, $F the sender's address."""
    water = sea(*PAIR)
    host = water.host(1)
    host.ask(b"$T002", b"$T002\r\n#B00264")
    assert len(host.read(64)) == 64
    host.expect(b"\r\n")
    host.ask(b"$E00204\r\n$?", b"$E00204\r\n#B00204\r\n$?\r\n")
    water.host(2)
    host.ask(b"$F", b"$F\r\n")
    water.host(2).expect(b"#F001\r\n")


@pytest.mark.parametrize("name", [b"CM", b"CC"])
def test_impulse_response(sea, name):
    """#CMxxxTtttttLzzzzz and z values of 2 bytes, or #TO."""
    host = sea(*PAIR).host(1)
    host.ask(b"$" + name + b"002", b"$" + name + b"002\r\n#" + name + b"002T")
    assert int(host.read(5)) * 1500 * 3.125e-5 == pytest.approx(150, abs=0.6)
    host.expect(b"L")
    assert any(host.read(2 * int(host.read(5))))
    host.expect(b"\r\n")
    host.ask(b"$" + name + b"009", b"$" + name + b"009\r\n#TO\r\n")


def test_quality_and_time_are_appended(sea):
    """QzzD+-ddd and T<14> after #B and #U when switched on; off at power-on."""
    water = sea(*PAIR)
    far = water.host(2)
    far.ask(b"$XQE", b"#XQE\r\n")
    water.host(1).ask(b"$B02ab", b"$B02\r\n")
    assert re.fullmatch(rb"#B00102abQ\d\dD[+-]\d{3}", far.line())
    far.write(b"$XTE")
    far.line()
    water.host(1).ask(b"$U00202ab", b"$U00202\r\n")
    assert re.fullmatch(rb"#U02abQ\d\dD[+-]\d{3}T\d{14}", far.line())
    water.host(1).ask(b"$F", b"$F\r\n")
    assert re.fullmatch(rb"#F001T\d{14}", far.line())
    far.write(b"$Q")
    assert re.fullmatch(rb"\$C\d+", far.line())
    far.ask(b"$R", b"$R\r\n")
    water.host(1).ask(b"$B02ab", b"$B02\r\n")
    far.expect(b"#B00102ab\r\n")


def test_scheduled_sending(sea):
    """T<14> sends at that microsecond, at most 2 s ahead."""
    water = sea(*PAIR)
    host = water.host(1)
    host.ask(b"$B02abT%014d" % 1, b"E\r\n")  # the timer is off
    host.write(b"$XTE")
    host.line()
    host.ask(b"$B02abT%014d" % 60_000_000, b"E\r\n")
    for _ in range(5):  # a busy machine may come too late: then E, again
        host.write(b"$XTG")
        moment = int(host.line()[-14:]) + 1_500_000
        host.write(b"$B02abT%014d" % moment)
        if host.line() == b"$B02":
            break
    water.wait(event="sent", kind="B")
    host.write(b"$XTG")
    assert int(host.line()[-14:]) >= moment


# One body of water


def test_two_packets_collide(sea):
    """Two broadcasts that overlap at a third modem are both lost there."""
    water = sea(*THREE)
    one, two, three = (water.host(n) for n in (1, 2, 3))
    one.write(b"$B64" + b"a" * 64)
    two.write(b"$B64" + b"b" * 64)
    assert {water.wait(event="collided", at=3)["from"] for _ in range(2)} == {1, 2}
    one.expect(b"$B64\r\n")
    one.ask(b"$U00302ok", b"$U00302\r\n")
    three.expect(b"#U02ok\r\n")  # the first that 3 says


def test_half_duplex(sea):
    """A modem that sends hears nothing: of two that send at once neither hears the other."""
    water = sea(*PAIR)
    one, two = water.host(1), water.host(2)
    one.write(b"$B64" + b"a" * 64)
    two.write(b"$B64" + b"b" * 64)
    assert {water.wait(event="lost", why="transmitting")["at"] for _ in range(2)} == {1, 2}
    one.expect(b"$B64\r\n")
    two.expect(b"$B64\r\n")
    one.ask(b"$B02ok", b"$B02\r\n")
    two.expect(b"#B00102ok\r\n")


def test_packets_in_turn_do_not_collide(sea):
    """The same two packets, one after the other at each receiver, are all heard."""
    water = sea(*THREE)
    one, two, three = (water.host(n) for n in (1, 2, 3))
    one.ask(b"$B02aa", b"$B02\r\n")
    two.expect(b"#B00102aa\r\n")
    two.ask(b"$B02bb", b"$B02\r\n")
    one.expect(b"#B00202bb\r\n")
    three.expect(b"#B00102aa\r\n#B00202bb\r\n")


def test_sleep_is_deaf_and_wakes_by_the_line(sea):
    """In $Z a ping does not wake the modem; $W, repeated until answered, does."""
    water = sea(*PAIR)
    far = water.host(2)
    far.ask(b"$Z", b"$Z\r\n")
    water.host(1).ask(b"$P002", b"$P002\r\n#TO\r\n")
    assert water.wait(event="lost", at=2)["why"] == "asleep"
    for _ in range(50):
        far.write(b"$W")
        if select.select([far.fd], [], [], 0.2)[0]:
            break
    far.expect(b"$W\r\n")
    water.host(1).ask(b"$P002", b"$P002\r\n")
    assert water.host(1).range()[0] == 2


def test_nothing_is_heard_in_air_or_out_of_reach(sea):
    """A modem above the water, or 4 km off, hears nothing."""
    water = sea("1:0:0:5", "2:10:0:-1", "3:4000:0:5", "4:100:0:5")
    near = water.host(4)
    water.host(1).ask(b"$B02ab", b"$B02\r\n")
    near.expect(b"#B00102ab\r\n")
    for at in (2, 3):
        assert water.wait(event="lost", at=at)["why"] == "too weak"


def test_loss_is_a_share(sea):
    """--loss 0.5 loses some of 20 beacons and not all."""
    water, outcomes = sea(*PAIR, "--loss", "0.5"), []
    for _ in range(20):
        water.host(1).ask(b"$F", b"$F\r\n")
        water.wait(event="sent", kind="F")
        outcomes.append(water.wait(kind="F", at=2)["event"])
    assert set(outcomes) == {"lost", "received"}


# The program


@pytest.mark.parametrize(
    "arguments",
    [
        ["1:0:0:5"],
        ["1:0:0:5", "1:9:0:5"],
        ["1:0:0:5", "256:0:0:5"],
        ["1:0:0:5", "2:0:0"],
        ["1:0:0:5", "2:0:0:5", "--loss", "2"],
    ],
)
def test_wrong_arguments(tmp_path, arguments):
    """The program says what is wrong and makes no link."""
    done = subprocess.run(
        [sys.executable, str(PROGRAM), str(tmp_path), *arguments],
        capture_output=True,
        text=True,
        timeout=LIMIT,
    )
    assert done.returncode == 2 and "error" in done.stderr and not os.listdir(tmp_path)
