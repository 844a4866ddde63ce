#!/usr/bin/env python3
"""Emulate two or more Newcastle nanomodems (v3) in one body of water, each on a pseudo-terminal.

What a modem says and how long its packets take is from the published facts; where these leave a choice
open, OPEN.md says what is done here, and the marks [1], [2] ... are its numbers.
"""

import argparse
import fcntl
import heapq
import itertools
import json
import math
import os
import random
import re
import selectors
import signal
import struct
import sys
import termios
import time
import tty
from contextlib import suppress
from types import SimpleNamespace as Namespace

BYTE = 10 / 9600  # one byte on the serial line, seconds
GAP = 0.002  # longest silence inside a command [1]
HEADER = 0.105  # ping, acknowledgement or command packet, seconds
TURNAROUND = 0.010  # from the end of a packet to the start of its answer [14]
TIMEOUT = 4.0  # from the start of a packet to #TO [15]
WAKING = 0.010  # from the first $W to an awake modem [10]
TICK = 3.125e-5  # unit of a range, seconds of one-way travel
SIGMA = 0.1  # spread of a range, metres [16]
SUPPLY = round(5.0 * 65536 / 15)  # 5 V [23]
VERSION = "R001.006.000B2024-02-15T00:00:00"
INAUDIBLE = -4.0  # dB: a weaker packet is neither heard nor in another's way [19]
HEAD = re.compile(
    rb"\$(?P<name>[?DFHRQNSZWB]|X[QF][ED]|XT[EDCG]|"
    rb"(?:[APVTUME]|C[MC])(?=(?P<to>[01]\d\d|2[0-4]\d|25[0-5])))"
)
HELP = "$? $Axxx $Bnn $Uxxxnn $Mxxxnn $Pxxx $Vxxx $Txxx $Exxxnn $F $CMxxx $CCxxx $D $H $R $Q $N $S $XQ $XT $XF $Z $W"
RANGING, SENDING, TIMED = ("P", "CM", "CC"), ("B", "U", "M", "P", "V", "T", "E", "F", "CM", "CC"), "BUMF"
# Packet error by payload (up to 16, 32, 64 bytes) at an SNR of -1 to 6 dB, and our ends of the rows [19].
ERRORS = {
    16: (1, 0.412, 0.161, 0.047, 0.015, 0.006, 0.003, 0.001, 0.001, 0),
    32: (1, 0.804, 0.553, 0.245, 0.089, 0.020, 0.010, 0.003, 0.001, 0),
    64: (1, 0.984, 0.932, 0.793, 0.483, 0.217, 0.068, 0.020, 0.007, 0),
}
KNOTS = (INAUDIBLE, -1, 0, 1, 2, 3, 4, 5, 6, 7)


def scan(buffer):
    """Parse `$...`: (name, address, data, moment), or None if that is not, or not yet, a whole command."""
    found = HEAD.match(buffer)
    if not found:
        return None
    name, data, moment = found["name"].decode(), b"", None
    address, rest = int(found["to"] or -1), bytes(buffer[found.end() + len(found["to"] or b"") :])
    if name in ("B", "U", "M", "E"):
        length = int(rest[:2]) if rest[:2].isdigit() else 0
        if not 2 <= length <= 64 or not len(rest[:2]) >= 2 or len(rest) < 2 + length:
            return None
        data, rest = rest[2 : 2 + length], rest[2 + length :]
    if rest:
        moment = re.fullmatch(rb"T(\d{14})", rest)
        if not moment or name not in TIMED:
            return None
    return name, None if address < 0 else address, data, int(moment[1]) if moment else None


def snr_at(metres):
    """Signal to noise ratio in dB at a distance."""
    return 168 - 20 * math.log10(max(metres, 1)) - 6 * metres / 1000 - (50 + 10 * math.log10(8000))


def packet_error(snr, size):
    """Probability that noise spoils a packet with `size` bytes of payload."""
    row = ERRORS[16 if size <= 16 else 32 if size <= 32 else 64]
    for k in range(len(KNOTS) - 1):
        if snr < KNOTS[k + 1]:
            share = max(0.0, (snr - KNOTS[k]) / (KNOTS[k + 1] - KNOTS[k]))
            return row[k] + share * (row[k + 1] - row[k])
    return 0.0


class Water:
    """The clock, the sound and the events to come. Events run in the order of their own times, so
    that a late process changes no outcome; `now` is the time of the event that runs."""

    def __init__(self, options):
        self.loss, self.speed, self.truth = options.loss, options.sound_speed, options.truth
        self.random, self.selector = random.Random(options.seed), selectors.DefaultSelector()
        self.modems, self.events, self.order = [], [], itertools.count()
        self.origin = self.now = time.monotonic()

    def at(self, when, call, *args):
        """Call `call(*args)` at the time `when`."""
        heapq.heappush(self.events, (when, next(self.order), call, args))

    def tell(self, event, packet, **more):
        """Print one line of truth [25]."""
        if self.truth:
            line = {
                "time": round(self.now - self.origin, 6),
                "event": event,
                "packet": packet.id,
                "kind": packet.kind,
                "from": packet.sender.unit,
                "to": packet.to,
                "bytes": len(packet.data),
            }
            print(json.dumps({**line, **more}), flush=True)

    def send(self, packet):
        """Let a packet travel from its sender to every other modem."""
        self.tell("sent", packet, duration=round(packet.duration, 6))
        for modem in self.modems:
            if modem is not packet.sender:
                metres = math.dist(packet.sender.place, modem.place)
                dry = min(packet.sender.place[2], modem.place[2]) < 0  # in air nothing hears [20]
                self.at(
                    self.now + metres / self.speed, modem.arrive, packet, -math.inf if dry else snr_at(metres)
                )

    def run(self):
        """Serve for ever: read what hosts wrote, then do what is due."""
        while True:
            ready = self.selector.select(max(0.0, self.events[0][0] - time.monotonic()))
            due = time.monotonic()
            for key, _ in ready:
                key.data.read(due)
            while self.events and self.events[0][0] <= due:
                self.now, _, call, args = heapq.heappop(self.events)
                call(*args)


class Modem:
    """One modem: its serial line, its settings and its ear."""

    def __init__(self, water, folder, unit, place):
        self.water, self.unit, self.place, self.address = water, unit, place, unit
        self.line_in = self.line_out = 0.0  # until when the serial line is busy
        self.count, self.buffer, self.parsed = 0, bytearray(), None
        self.hearing, self.sending_until, self.awake_at = [], 0.0, 0.0
        self.start_again()
        self.master, self.slave = os.openpty()  # we keep the slave open: hosts come and go
        tty.setraw(self.slave)
        mode = termios.tcgetattr(self.slave)
        mode[2] |= termios.CLOCAL | termios.CREAD
        mode[4] = mode[5] = termios.B9600
        termios.tcsetattr(self.slave, termios.TCSANOW, mode)
        os.set_blocking(self.master, False)
        water.selector.register(self.master, selectors.EVENT_READ, self)
        self.name, self.link = os.ttyname(self.slave), os.path.join(folder, f"modem{unit}")
        if os.path.islink(self.link):  # left by a run that was killed
            os.unlink(self.link)
        os.symlink(self.name, self.link)
        self.unlock()

    def start_again(self):
        """Power-on state of all but the address."""
        self.quality = self.clock_on = False
        self.clock_base, self.clock_held = 0.0, 0
        self.corrected = self.waiting = self.planned = None
        self.epoch = object()  # answers promised before are void

    def unlock(self):
        """Lift a host's exclusive lock now and then, as it would outlive that host [26]."""
        fcntl.ioctl(self.slave, termios.TIOCNXCL)
        self.water.at(time.monotonic() + 0.5, self.unlock)

    def read(self, now):
        """Take what the host wrote; a byte counts from when the real line would have carried it."""
        data = b""
        with suppress(OSError):
            data = os.read(self.master, 4096)
        for byte in data:
            self.line_in = max(now, self.line_in) + BYTE
            self.feed(byte)
        self.count += len(data)
        self.water.at(self.line_in + GAP, self.silence, self.count)

    def feed(self, byte):
        """Take one byte of a command."""
        if self.parsed and byte != ord("T"):  # it was whole, without a time
            self.finish(self.line_in, self.parsed)
        if (self.buffer or byte == ord("$")) and len(self.buffer) < 100:  # [2]
            self.buffer.append(byte)
            self.parsed = scan(self.buffer)
            if self.parsed and (self.parsed[0] not in TIMED or self.parsed[3] is not None):
                self.finish(self.line_in, self.parsed)

    def silence(self, count):
        """Nothing came for GAP after byte number `count`: what is not whole by now is an error [3]."""
        if count == self.count and self.buffer:
            self.finish(self.water.now, self.parsed or ("error",))

    def finish(self, when, command):
        """Do a command (or the error) at `when` and wait for the next."""
        self.buffer, self.parsed = bytearray(), None
        self.water.at(when, self.command, *command)

    def say(self, text):
        """Send an answer to the host at the pace of the line."""
        data = (text.encode() if isinstance(text, str) else text) + b"\r\n"
        self.line_out = max(self.water.now, self.line_out)
        for k in range(0, len(data), 8):
            self.line_out += BYTE * len(data[k : k + 8])
            self.water.at(self.line_out, self.write, data[k : k + 8])

    def write(self, data):
        """Put bytes on the line; what does not fit is lost [26]."""
        with suppress(OSError):
            os.write(self.master, data)

    def later(self, seconds, answer):
        """Give an answer after a while, unless reset or put to sleep before."""
        epoch = self.epoch
        self.water.at(self.water.now + seconds, lambda: self.epoch is epoch and self.say(answer))

    def command(self, name, address=None, data=b"", moment=None):
        """Do one command."""
        now, gauss = self.water.now, self.water.random.gauss
        if now < self.awake_at:  # asleep: deaf to all but $W [10]
            if name == "W":
                self.awake_at = min(self.awake_at, now + WAKING)
        elif name == "error":
            self.say("E")
        elif name in SENDING:
            self.order(name, address, data, moment)
        elif name == "?":
            self.say(f"#A{self.address:03d}V{SUPPLY:05d}{VERSION}")
        elif name == "A":
            self.address = address
            self.say(f"#A{address:03d}")
        elif name == "D":
            a = (0x4E4D0000 + self.unit) * 2654435761 & 0xFFFFFFFF  # [24]
            self.say(f"#DID:0x{a:08X}-A8{a & 0xFF:02X}-A16{a & 0xFFFF:04X}-A24{a & 0xFFFFFF:06X}-A32{a:08X}")
        elif name == "H":
            self.say("Commands: " + HELP)
        elif name == "Q":
            self.say("$C-" if self.corrected is None else f"$C{self.corrected}")
        elif name == "N":
            self.say("$N")
            self.later(1.0, "#N" + self.noise())
        elif name == "S":
            self.say("$S")
            self.later(
                2.0, b"#S00257" + struct.pack("<257H", *(max(0, round(gauss(200, 20))) for _ in range(257)))
            )
        elif name.startswith("XT"):  # [11]
            self.clock_held = 0 if name == "XTC" else self.clock(now)
            self.clock_base = now - self.clock_held / 1e6
            self.clock_on = {"XTE": True, "XTD": False}.get(name, self.clock_on)
            self.say(f"#XT{name[2] if name[2] in 'ED' else 'DE'[self.clock_on]}{self.clock_held:014d}")
        elif name.startswith("X"):
            self.quality = {"XQE": True, "XQD": False}.get(name, self.quality)
            self.say("#" + name)
        else:  # R, Z and W
            self.say("$" + name)
            if name == "R":
                self.start_again()
            elif name == "Z":
                self.waiting, self.planned, self.epoch, self.awake_at = None, None, object(), math.inf
                self.spoil("asleep")

    def noise(self):
        """Noise: root mean square, peak to peak, mean magnitude [23]."""
        rms = abs(self.water.random.gauss(400, 20))
        return f"R{round(rms):06d}P{round(8 * rms):06d}M{round(0.8 * rms):06d}"

    def clock(self, when):
        """What the 1 MHz timer shows."""
        return (round((when - self.clock_base) * 1e6) if self.clock_on else self.clock_held) % 10**14

    def order(self, name, address, data, moment):
        """A command that sends a packet, now or at a moment of the timer [12] [13]."""
        now, delay = self.water.now, 0.0
        if moment is not None:
            delay = (moment - self.clock(now)) / 1e6 if self.clock_on else -1.0
        if (
            not 0 <= delay <= 2
            or self.sending_until > now
            or self.planned
            or (self.waiting and (name in RANGING or name == "M"))
            or (name in RANGING and address == self.address)
        ):
            self.say("E")
            return
        self.say(
            f"${name}" + ("" if address is None else f"{address:03d}") + (f"{len(data):02d}" if data else "")
        )
        self.planned = plan = object()
        self.water.at(now + delay, self.depart, plan, name, address, data)

    def depart(self, plan, name, address, data):
        """Start the packet that the host ordered, and the wait for its answer."""
        if self.planned is plan:
            self.planned, packet = None, self.transmit(name, address, data)
            if name in RANGING or name == "M":
                self.waiting = packet
                self.water.at(packet.start + TIMEOUT, self.give_up, packet)

    def give_up(self, packet):
        """No answer came in time."""
        if self.waiting is packet:
            self.waiting = None
            self.say("#TO")

    def spoil(self, why):
        """Lose whatever is arriving now."""
        for reception in self.hearing:
            reception.why = reception.why or why

    def transmit(self, kind, to, data=b""):
        """Send a packet now; it is lost if the modem still sends another one, or sleeps."""
        length = HEADER + (len(data) + 16) * 0.0125 if data else HEADER
        packet = Namespace(
            id=next(self.water.order),
            sender=self,
            source=self.address,
            kind=kind,
            to=to,
            data=data,
            start=self.water.now,
            duration=length,
        )
        if max(self.sending_until, self.awake_at) > self.water.now:
            self.water.tell("lost", packet, at=self.unit, why="sender busy or asleep")
        else:
            self.sending_until = self.water.now + packet.duration
            self.spoil("transmitting")
            self.water.send(packet)
        return packet

    def arrive(self, packet, snr):
        """The front of a packet reaches this modem."""
        soon = self.water.now + 1e-9  # touching packets do not overlap
        reception = Namespace(packet=packet, snr=snr, start=self.water.now, why="too weak")
        if snr > INAUDIBLE:
            reception.why = (
                "asleep"
                if self.awake_at > soon
                else "transmitting"
                if self.sending_until > soon
                else "collision"
                if self.hearing
                else None
            )
            self.spoil("collision")
            self.hearing.append(reception)
        self.water.at(self.water.now + packet.duration - 2e-9, self.heard, reception)

    def heard(self, reception):
        """The end of a packet has reached this modem."""
        packet, why, chance = reception.packet, reception.why, self.water.random.random
        if reception in self.hearing:
            self.hearing.remove(reception)
        if not why and chance() < packet_error(reception.snr, len(packet.data)):
            why = "noise"
        if not why and chance() < self.water.loss:
            why = "loss"
        if why:
            self.water.tell("collided" if why == "collision" else "lost", packet, at=self.unit, why=why)
        else:
            self.water.tell("received", packet, at=self.unit)
            if packet.to in (None, self.address):
                self.take(packet, reception)

    def take(self, packet, reception):
        """Act on a whole packet that is for this modem."""
        kind, size = packet.kind, f"{len(packet.data):02d}"
        stamp = f"T{self.clock(reception.start):014d}" if self.clock_on else ""  # [17]
        if kind in ("B", "U", "M"):
            self.corrected = min(8, max(0, int(8 - reception.snr)))  # [21]
            extra = (f"Q{self.corrected:02d}D+000" if self.quality else "") + stamp
            head = f"#B{packet.source:03d}" if kind == "B" else "#U"
            self.say((head + size).encode() + packet.data + extra.encode())
        elif kind == "F":
            self.say(f"#F{packet.source:03d}{stamp}")
        elif kind == "ack" and self.waiting and self.waiting.to == packet.source:
            self.answered(packet)
        text = f"Test packet of 64 bytes from nanomodem {self.address:03d} ".ljust(64, ".").encode()
        answers = {"V": f"V{SUPPLY:05d}{self.noise()}".encode(), "T": text, "E": packet.data}
        if kind in RANGING or kind == "M":
            self.water.at(self.water.now + TURNAROUND, self.transmit, "ack", packet.source)
        elif kind in answers:
            self.water.at(self.water.now + TURNAROUND, self.transmit, "B", None, answers[kind])

    def answered(self, ack):
        """The answer to a ping or an acknowledged unicast: tell the host the range."""
        asked, self.waiting = self.waiting, None
        travel = (self.water.now - asked.start - asked.duration - TURNAROUND - ack.duration) / 2
        travel += self.water.random.gauss(0, SIGMA) / self.water.speed
        result = f"{ack.source:03d}T{min(99999, max(0, round(travel / TICK))):05d}"
        if asked.kind in ("P", "M"):
            self.say("#R" + result)
            return
        taps = [0] * 256  # the direct path alone [22]
        taps[32] = 30000
        values = taps if asked.kind == "CM" else [value for tap in taps for value in (tap, 0)]
        head = f"#{asked.kind}{result}L{len(values):05d}".encode()
        self.say(head + struct.pack(f"<{len(values)}h", *values))


def place_of(text):
    """Read ADDRESS:NORTH:EAST:DEPTH."""
    try:
        address, *where = text.split(":")
        north, east, depth = map(float, where)
        if 0 <= int(address) <= 255 and math.isfinite(north + east + depth):
            return int(address), (north, east, depth)
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"{text!r} is not ADDRESS:NORTH:EAST:DEPTH, address 0 to 255")


def main():
    """Link the modems and serve until a signal."""
    parser = argparse.ArgumentParser(description="Emulate nanomodems in one body of water.")
    parser.add_argument("folder", help="where the links modemADDRESS are made")
    parser.add_argument(
        "modems", nargs="+", type=place_of, metavar="ADDRESS:NORTH:EAST:DEPTH", help="in metres"
    )
    parser.add_argument("--loss", type=float, default=0.0, help="share of packets lost at each receiver")
    parser.add_argument("--seed", type=int, help="seed of the random numbers")
    parser.add_argument("--sound-speed", type=float, default=1500.0, help="metres per second")
    parser.add_argument("--truth", action="store_true", help="print a JSON line for what each packet meets")
    options = parser.parse_args()
    if len(options.modems) < 2 or len(dict(options.modems)) < len(options.modems):
        parser.error("give two or more modems, each with its own address")
    if not 0 <= options.loss <= 1 or not 0 < options.sound_speed < math.inf:
        parser.error("the loss is from 0 to 1, and the speed of sound above 0")
    for end in (signal.SIGTERM, signal.SIGINT):
        signal.signal(end, lambda *_: sys.exit(0))
    os.makedirs(options.folder, exist_ok=True)
    water = Water(options)
    try:
        for address, where in options.modems:
            water.modems.append(Modem(water, options.folder, address, where))
        print("ready", flush=True)
        water.run()
    finally:
        for end in (signal.SIGTERM, signal.SIGINT):
            signal.signal(end, signal.SIG_IGN)
        for modem in water.modems:  # remove the links that are still ours
            if os.path.islink(modem.link) and os.readlink(modem.link) == modem.name:
                os.unlink(modem.link)


if __name__ == "__main__":
    main()
