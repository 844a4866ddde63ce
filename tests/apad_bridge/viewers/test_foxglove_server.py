"""A publisher whose definition differs from the installed one is shown by its own."""

from __future__ import annotations

import json
from contextlib import closing

import websocket

from apad_bridge.records.bag import RecordedConnection, RecordedMessage
from apad_bridge.viewers.foxglove_server import _Views

MD5, OTHER = "0" * 32, "1" * 32


def test_a_channel_takes_its_publishers_definition() -> None:
    with closing(_Views()) as views:
        link = websocket.create_connection(
            "ws://{}:{}".format(*views.address), 60, subprotocols=["foxglove.sdk.v1"]
        )
        assert json.loads(link.recv())["op"] == "serverInfo"
        views.offer("/depth", "lab_msgs/Depth", MD5, "float32 depth_m\n")
        (first,) = json.loads(link.recv())["channels"]
        assert (first["schema"], first["encoding"]) == ("float32 depth_m\n", "ros1")

        theirs = RecordedConnection("/depth", "lab_msgs/msg/Depth", "float64 depth_m\n", OTHER)
        views.pass_on(RecordedMessage(theirs, 7, bytes(8)))
        assert json.loads(link.recv()) == {"op": "unadvertise", "channelIds": [first["id"]]}
        (second,) = json.loads(link.recv())["channels"]
        assert (second["schemaName"], second["schema"]) == ("lab_msgs/Depth", "float64 depth_m\n")

        link.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 5, "channelId": second["id"]}]}))
        assert views.changes.get(timeout=60) == ("/depth", 1)
        views.pass_on(RecordedMessage(theirs, 7, b"8 bytes!"))
        assert link.recv() == b"\x01" + (5).to_bytes(4, "little") + (7).to_bytes(8, "little") + b"8 bytes!"
        link.close()
        assert views.changes.get(timeout=60) == ("/depth", -1)
