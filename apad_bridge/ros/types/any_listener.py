"""Subscribes to a topic whatever its publisher's definition: ours where the md5 agrees, else the one it sends along."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import rospy

from apad_bridge.ros.types.any_message import AnyMessages


class AnyListener:
    """`failed` is told, in rospy's thread, of a message that could not be read, or lacks what `take` reads of it."""

    def __init__(self, failed: Callable[[str], None]) -> None:
        self._failed = failed
        self._messages = AnyMessages()

    def listen(self, topic: str, ours: Any, take: Callable[..., None], *arguments: Any) -> rospy.Subscriber:
        """`take(message, *arguments)` is called for each message."""

        def taken(raw: Any) -> None:
            try:
                if not isinstance(raw, rospy.AnyMsg):
                    # rospy has one reader for a topic, and another part of this process asked for it by its class.
                    message = raw
                elif raw._connection_header["md5sum"] == ours._md5sum:
                    message = ours().deserialize(raw._buff)
                else:
                    message = self._messages.decode(raw)
                take(message, *arguments)
            except (ValueError, AttributeError, KeyError) as error:
                self._failed(f"{topic}: {error}")

        # No delay: otherwise a small message may wait on a network for the acknowledgement of the one before.
        return rospy.Subscriber(topic, rospy.AnyMsg, taken, tcp_nodelay=True)
