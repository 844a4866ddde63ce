"""Subscribes to topics of any definition: uses ours where the md5 agrees, else the one that the publisher sends."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import genpy
import rospy

from apad_bridge.ros.types.any_message import AnyMessages, why_unfit
from firmware_model.entry_points import in_one_line


class AnyListener:
    """Calls `refuse(topic, node, why)`, in rospy's thread, for a message of `node` that its reader cannot use."""

    def __init__(self, refuse: Callable[[str, str, str], None]) -> None:
        self._refuse = refuse
        self._messages = AnyMessages()

    def listen(
        self, topic: str, ours: Any, fields: tuple[str, ...], take: Callable[..., None], *arguments: Any
    ) -> rospy.Subscriber:
        """Calls `take(message, *arguments)`, which reads `fields`, for each message."""
        # Without a delay: a small message could otherwise wait for the acknowledgement of the one before.
        return rospy.Subscriber(
            topic, rospy.AnyMsg, self.receiver(topic, ours, fields, take, *arguments), tcp_nodelay=True
        )

    def receiver(
        self, topic: str, ours: Any, fields: tuple[str, ...], take: Callable[..., None], *arguments: Any
    ) -> Callable[[Any], None]:
        """Returns the function that takes a message of any definition off a connection and calls `take` with it.

        Each of `fields` has the kind of value that it has in `ours`: the core of a flight trusts them.
        """
        unfit: dict[str, str | None] = {ours._md5sum: None}
        """By md5, why messages of that definition are not read; None for one that is."""

        def decoded(raw: Any) -> Any:
            md5 = raw._connection_header["md5sum"]
            if md5 == ours._md5sum:
                return ours().deserialize(raw._buff)
            if md5 not in unfit:
                unfit[md5] = why_unfit(self._messages.class_of_sender(raw), ours, fields)
            if (why := unfit[md5]) is not None:
                raise ValueError(why)
            return self._messages.decode(raw)

        def receive(raw: Any) -> None:
            try:
                # rospy has one reader a topic: another part of this process may subscribe by the class.
                message = decoded(raw) if isinstance(raw, rospy.AnyMsg) else raw
                message._connection_header = raw._connection_header
                take(message, *arguments)
            except genpy.DeserializationError:
                self._refuse(topic, node_of(raw), "bytes that are not of its definition")
            except (ValueError, AttributeError, KeyError, TypeError) as error:
                self._refuse(topic, node_of(raw), str(error))
            except Exception as error:  # rospy would only log it, for each message
                self._refuse(topic, node_of(raw), f"its reader fails: {in_one_line(error)}")

        return receive


def node_of(raw: Any) -> str:
    return str((raw._connection_header or {}).get("callerid", "an unnamed node"))
