"""Subscribes to topics of any definition: uses ours where the md5 agrees, else the one that the publisher sends."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import genpy
import rospy

from apad_bridge.ros.types.any_message import AnyMessages


class AnyListener:
    """Calls `failed`, in rospy's thread, for a message that cannot be read or lacks a field that `take` reads."""

    def __init__(self, failed: Callable[[str], None]) -> None:
        self._failed = failed
        self._messages = AnyMessages()

    def listen(self, topic: str, ours: Any, take: Callable[..., None], *arguments: Any) -> rospy.Subscriber:
        """Calls `take(message, *arguments)` for each message."""

        def receive(raw: Any) -> None:
            try:
                if not isinstance(raw, rospy.AnyMsg):
                    # rospy has one reader a topic, and another part of this process subscribes by the class.
                    message = raw
                elif raw._connection_header["md5sum"] == ours._md5sum:
                    message = ours().deserialize(raw._buff)
                    message._connection_header = raw._connection_header
                else:
                    message = self._messages.decode(raw)
                    message._connection_header = raw._connection_header
                take(message, *arguments)
            except genpy.DeserializationError:
                self._failed(f"{topic}: bytes that are not of its definition")
            except (ValueError, AttributeError, KeyError) as error:
                self._failed(f"{topic}: {error}")

        # Without a delay: a small message could otherwise wait for the acknowledgement of the one before.
        return rospy.Subscriber(topic, rospy.AnyMsg, receive, tcp_nodelay=True)
