"""Our definitions are those of an existing aPad: the md5s are that stack's published ones, not computed here."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from apad_bridge.ros.types.generate import GenerationFailed, generate
from apad_bridge.ros.types.messages import (
    DEFINITIONS,
    STAMP,
    MessagesUnusable,
    definitions_digest,
    use_generated_messages,
)

LEGACY_MD5 = {
    "apad/msg/aPadAction": "e8c67cfc7156bad21904e5f2ee500527",
    "apad/msg/aPadGoal": "eca4d4e6ce7927bca8845cd4424fc301",
    "apad/msg/aPadResult": "f594e9bdd560d0ab0935ac82a0afebd6",
    "apad/msg/aPadFeedback": "6494c2374aa3a3b8f405dc4f44f026b3",
    "auv_msgs/msg/NavSts": "d1c2e3fd518b63978e72fa7409f4ba71",
    "auv_msgs/msg/NED": "4a16ce817ea5a7912b32dfb04540797b",
    "misc_msgs/srv/GetDockingInfo": "139c8b6b67bdb35759761ea3d907700d",
    "misc_msgs/srv/ChangeDockingStatus": "b67c9291ad6ab468689325dc98ab7a98",
    "misc_msgs/srv/GetChargeInfo": "9b253f7540e802f303614046b9243df1",
    "misc_msgs/srv/Go2pointPrimitiveService": "4a0312be411e8ffc59f768d30e967664",
    "misc_msgs/srv/DynamicPositioningPrimitiveService": "b012ae796923d5321c7c678ac0cc7797",
    "misc_msgs/srv/DockingPrimitiveService": "2f37c62380c61eaf8bf8692a9128c0fd",
    "misc_msgs/srv/SendEnergy": "1776bdc327ac593f29492e9bad1e15d2",
    "misc_msgs/srv/GetPosition": "4a842b65f413084dc2b10fb484ea7f17",
    "misc_msgs/srv/GetSensoryReading": "1634c573362b3eca9589d81d03b20094",
    "navcon_msgs/srv/EnableControl": "8c1211af706069c994c06e00eb59ac9e",
    "navcon_msgs/srv/ConfigureVelocityController": "0d3d3fedfba2222a7ab225c0011694f3",
    "navcon_msgs/msg/GoToPointGoal": "8156373f227e0e6c1ef30a6945ce353a",
    "navcon_msgs/msg/GoToPointResult": "d65ced8ada943f29d726e71ce5dd7e80",
    "navcon_msgs/msg/GoToPointFeedback": "a85492da5f0b70ed123ffefd6b539114",
    "underwater_msgs/msg/ModemTransmission": "5e0325f7a81227cf50eb2f548efec3ad",
    "underwater_msgs/msg/MediumTransmission": "11f270ad3c6a896e6e40b3ee541fbd39",
    "uuv_sensor_msgs/msg/AcousticModemRequest": "a84b6bdf495d095a282cd17cd0682ae4",
    "uuv_sensor_msgs/msg/AcousticModemPayload": "6ee66ed96aa9a69589dc1008fee65ce4",
    "uuv_sensor_msgs/msg/AcousticModemRange": "d41ea0b9d0d8580cb0eceda00eab751e",
}
OWN_MESSAGES = [
    "DockAlert",
    "AgentBelief",
    "AgentTruth",
    "APadStatus",
    "FleetBeliefs",
    "FleetClaim",
    "FleetTruth",
    "Forecast",
    "MissionEvent",
    "Packet",
]


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("generated") / "ros"
    generate(folder)
    return folder


def in_a_fresh_interpreter(folder: Path, code: str) -> str:
    """Runs `code` with the generated classes elsewhere, because an imported package stays with its interpreter."""
    program = f"import sys; sys.path.insert(0, {str(folder)!r})\n{code}"
    done = subprocess.run([sys.executable, "-I", "-c", program], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_generated_classes_carry_the_same_md5s(generated: Path) -> None:
    lines = [
        f"from {n.split('/')[0]}.{n.split('/')[1]} import {n.split('/')[2]} as C; print({n!r}, C._md5sum)"
        for n in LEGACY_MD5
    ]
    printed = in_a_fresh_interpreter(generated, "\n".join(lines))
    assert dict(line.split() for line in printed.splitlines()) == LEGACY_MD5


def test_every_definition_is_generated(generated: Path) -> None:
    for text in DEFINITIONS.glob("*/*/*"):
        package, kind = text.parts[-3:-1]
        stems = (
            [f"{text.stem}{suffix}" for suffix in ("Action", "Goal", "ActionFeedback")]
            if kind == "action"
            else [text.stem]
        )
        for stem in stems:
            assert (generated / package / ("msg" if kind == "action" else kind) / f"_{stem}.py").exists()
        assert (generated / package / "package.xml").exists()
    assert sorted(f.stem.lower() for f in DEFINITIONS.glob("musselbed_msgs/msg/*.msg")) == sorted(
        name.lower() for name in OWN_MESSAGES
    )


def test_a_wrong_definition_is_named_and_what_stood_there_stays(tmp_path: Path) -> None:
    for name, text in (
        ("good/some_msgs/msg/Fine", "uint8 value\n"),
        ("bad/some_msgs/msg/Broken", "no_such_msgs/Thing it\n"),
    ):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / f"{name}.msg").write_text(text)
    generate(tmp_path / "ros", tmp_path / "good")
    with pytest.raises(GenerationFailed, match=r"some_msgs/msg/Broken\.msg: no_such_msgs/Thing"):
        generate(tmp_path / "ros", tmp_path / "bad")
    assert (tmp_path / "ros" / "some_msgs" / "msg" / "_Fine.py").exists()


def test_missing_and_outdated_messages_say_how_to_mend_it(tmp_path: Path) -> None:
    with pytest.raises(MessagesUnusable, match=r"no generated ROS messages.*launch_scripts/install"):
        use_generated_messages(tmp_path)
    (tmp_path / STAMP).write_text("of other definitions\n")
    with pytest.raises(MessagesUnusable, match=r"older than their definitions.*launch_scripts/install"):
        use_generated_messages(tmp_path)


@pytest.mark.parametrize(
    ("init", "code", "told"),
    [
        pytest.param(
            "raise RuntimeError('of another workspace')\n",
            "use_generated_messages(Path(ours)); use_generated_messages(Path(ours))\n"
            "import auv_msgs.msg; print(Path(auv_msgs.__file__).is_relative_to(ours), sys.path.count(ours))",
            "True 1\n",
            id="another workspace does not come between",
        ),
        pytest.param(
            "",
            "import auv_msgs\n"
            "try: use_generated_messages(Path(ours))\n"
            "except MessagesUnusable as error: print(str(error).partition(' /')[0])",
            "auv_msgs was already imported from\n",
            id="an earlier import from elsewhere is an error",
        ),
    ],
)
def test_another_workspace_on_the_path(
    generated: Path, tmp_path: Path, init: str, code: str, told: str
) -> None:
    (tmp_path / "auv_msgs").mkdir()
    (tmp_path / "auv_msgs" / "__init__.py").write_text(init)
    begin = (
        f"sys.path.insert(1, {str(Path(__file__).parents[4])!r}); ours = {str(generated)!r}\n"
        f"sys.path.remove(ours); sys.path.insert(0, {str(tmp_path)!r}); sys.path.append(ours)\n"
        "from pathlib import Path\n"
        "from apad_bridge.ros.types.messages import MessagesUnusable, use_generated_messages\n"
    )
    assert in_a_fresh_interpreter(generated, begin + code) == told


def test_the_digest_notices_any_change(tmp_path: Path) -> None:
    folder = tmp_path / "p" / "msg"
    folder.mkdir(parents=True)
    seen = set()
    for name, text in (("A.msg", "uint8 a\n"), ("A.msg", "uint8 b\n"), ("B.msg", "uint8 b\n")):
        (folder / name).write_text(text)
        seen.add(definitions_digest(tmp_path))
    assert len(seen) == 3
