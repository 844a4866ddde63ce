"""Serializes our ROS messages for the bags without ROS, from the same .msg texts that genpy uses."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from struct import Struct, pack
from typing import Any, cast

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from agents.time_scale import MissionMs, TimeScale
from apad_bridge.beliefs.belief import NUMBERS
from apad_bridge.records.packet_lines import SoundRow
from apad_bridge.records.samples import APadSample, BeliefSample, TruthSample
from apad_bridge.ros_names.frames import Frames

_DEFINITIONS = Path(__file__).parent.parent / "ros" / "definitions"
_STANDARD = Path(__file__).parent / "definitions"
"""ROS's own texts of the standard messages that ours contain."""
_FOLDERS = {
    **dict.fromkeys(("auv_msgs", "musselbed_msgs", "underwater_msgs"), _DEFINITIONS),
    **dict.fromkeys(("geometry_msgs", "std_msgs"), _STANDARD),
}
"""The folder of each package of a bag's messages."""

TRUTH = "musselbed_msgs/msg/FleetTruth"
BELIEFS = "musselbed_msgs/msg/FleetBeliefs"
APAD = "musselbed_msgs/msg/APadStatus"
EVENT = "musselbed_msgs/msg/MissionEvent"
SOUND = "underwater_msgs/msg/MediumTransmission"

_FRAME = Frames().ned
"""A bag's names do not depend on the namespace on the graph."""
_MODES = BeliefSample._fields.index("mode_probabilities")
_COUNT = Struct("<I")
_TRUTH_ROW = Struct("<HBffddf?Q").pack
"""AgentTruth.msg."""


def _belief_row(agent: BeliefSample) -> bytes:
    """AgentBelief.msg."""
    modes, reported, parts = agent.mode_probabilities, agent.reported, agent.charge_parts
    return pack(
        f"<HBffddf8fI{len(modes)}fffHBI{len(reported)}dI{len(parts)}f",
        *agent[:_MODES],
        len(modes),
        *modes,
        *agent[_MODES + 1 : -2],
        len(reported),
        *reported,
        len(parts),
        *parts,
    )


@cache
def typestore() -> Typestore:
    """The types of our messages in a bag, of the laboratory's, and of the standard ones that these contain.

    The library's own store of all standard messages takes four times as long to make.
    """
    store = get_typestore(Stores.EMPTY)
    types: dict[str, Any] = {}
    for package, folder in _FOLDERS.items():
        for path in sorted((folder / package / "msg").glob("*.msg")):
            types.update(get_types_from_msg(path.read_text(encoding="utf-8"), f"{package}/msg/{path.stem}"))
    store.register(types)
    return store


def definition(name: str) -> tuple[str, str]:
    """The full text of a message's definition, as genpy has it with all comments, and its md5.

    rosbags would write a text without comments, and `rosbag check` would find that it differs.
    """
    texts = [_text(name)]
    for nested in dict.fromkeys(_nested(name)):
        texts.append(f"{'=' * 80}\nMSG: {nested.replace('/msg/', '/')}\n{_text(nested)}")
    return "\n".join(texts), typestore().generate_msgdef(name)[1]


def _text(name: str) -> str:
    package, _, message = name.partition("/msg/")
    return (_FOLDERS[package] / package / "msg" / f"{message}.msg").read_text(encoding="utf-8")


def _nested(name: str) -> Iterator[str]:
    """The messages in a message, each before those in it."""
    for _, field in typestore().fielddefs[name][1]:
        kind, inner = field
        while kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            kind, inner = cast(Any, inner)[0]
        if kind is Nodetype.NAME and not str(inner).startswith("builtin_interfaces/"):
            yield str(inner)
            yield from _nested(str(inner))


class Messages:
    """Serializes samples as ROS 1 messages. `stamp_ms` returns the header's stamp for a mission time."""

    def __init__(self, scale: TimeScale, stamp_ms: Callable[[int], int] = int) -> None:
        self._scale = scale
        self._stamp_ms = stamp_ms
        self._store = typestore()
        types = self._store.types
        self._time: Any = types["builtin_interfaces/msg/Time"]
        self._header: Any = types["std_msgs/msg/Header"]
        self._fleet_truth: Any = types[TRUTH]
        self._apad_status: Any = types[APAD]
        self._mission_event: Any = types[EVENT]
        self._transmission: Any = types[SOUND]
        self._names = b"".join(
            (_COUNT.pack(len(NUMBERS)), *(pack(f"<I{len(it)}s", len(it), it.encode()) for it in NUMBERS))
        )
        """FleetBeliefs.msg's `reported_names`."""

    def truth(self, now_ms: MissionMs, agents: list[TruthSample]) -> bytes:
        return self._fleet(now_ms, [_TRUTH_ROW(*agent) for agent in agents])

    def beliefs(self, now_ms: MissionMs, agents: list[BeliefSample]) -> bytes:
        return self._fleet(now_ms, map(_belief_row, agents), self._names)

    def _fleet(self, now_ms: MissionMs, rows: Iterable[bytes], names: bytes = b"") -> bytes:
        """FleetTruth or FleetBeliefs, which begin alike: but for `names`, before the rows.

        The library serializes the beginning. The rows are most of a run's bag, and it packs each field by itself.
        """
        empty = self._fleet_truth(self._head(now_ms), now_ms, self._scale.agent_ms(now_ms), [])
        all_rows = list(rows)
        head = self._serialize(empty, TRUTH)[: -_COUNT.size]
        return b"".join((head, names, _COUNT.pack(len(all_rows)), *all_rows))

    def apad(self, now_ms: int, apad: APadSample) -> bytes:
        *numbers, primitive, docks = apad
        message = self._apad_status(
            self._head(now_ms), now_ms, *numbers, primitive, np.array(docks, dtype=np.int32)
        )
        return self._serialize(message, APAD)

    def event(self, now_ms: int, kind: str, data: str) -> bytes:
        return self._serialize(self._mission_event(self._head(now_ms), now_ms, kind, data), EVENT)

    def sound(self, now_ms: int, row: SoundRow) -> bytes:
        """A packet at one listener, without places: the truth has them."""
        message = self._transmission(
            header=self._head(now_ms),
            message=row.message,
            duration=row.duration_s,
            gain=0.0,
            sender=row.sender,
            receiver=row.receiver,
            snr=row.snr_db,
            position=self._nowhere(now_ms),
            range=row.range_m,
            azimuth=0.0,
            elevation=0.0,
            listener_id=row.listener,
            conflict=row.conflict,
        )
        return self._serialize(message, SOUND)

    def _nowhere(self, now_ms: int) -> Any:
        types: Any = self._store.types
        ned, rpy = types["auv_msgs/msg/NED"](0.0, 0.0, 0.0), types["auv_msgs/msg/RPY"](0.0, 0.0, 0.0)
        degrees = types["auv_msgs/msg/DecimalLatLon"](0.0, 0.0)
        point = types["geometry_msgs/msg/Point"](0.0, 0.0, 0.0)
        return types["auv_msgs/msg/NavSts"](
            header=self._head(now_ms),
            global_position=degrees,
            origin=degrees,
            position=ned,
            altitude=0.0,
            body_velocity=point,
            gbody_velocity=point,
            orientation=rpy,
            orientation_rate=rpy,
            position_variance=ned,
            orientation_variance=rpy,
            status=0,
        )

    def _head(self, now_ms: int) -> object:
        stamp_ms = self._stamp_ms(now_ms)
        return self._header(0, self._time(stamp_ms // 1000, stamp_ms % 1000 * 1_000_000), _FRAME)

    def _serialize(self, message: object, name: str) -> bytes:
        return cast(bytes, self._store.serialize_ros1(message, name))
