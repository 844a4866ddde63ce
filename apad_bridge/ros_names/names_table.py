"""The table of names on the graph, with the node that offers each name and when. `names.py` explains its use."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from apad_bridge.events.person_orders import PERSON_ORDERS

BATTERY_ALERT, CLOCK, CLOCK_REACHED, TF, TF_STATIC, DIAGNOSTICS, USE_SIM_TIME = (
    "/battery_alert",
    "/clock",
    "/clock_reached",
    "/tf",
    "/tf_static",
    "/diagnostics",
    "/use_sim_time",
)


class NameKind(StrEnum):
    TOPIC = "topic"
    SERVICE = "service"
    ACTION = "action"
    PARAMETER = "parameter"


@dataclass(frozen=True, slots=True)
class NameRow:
    """`name` is the name without a namespace and without the slash before it; {apad} and {id} stand for any.

    `who` publishes or offers it; `when` gives its rate or its purpose, and for a global name the reason.
    """

    name: str
    kind: NameKind
    type: str
    who: str
    when: str
    is_common: bool = False
    """True for a name of ours that several supervisors side by side have in common."""


@dataclass(frozen=True, slots=True)
class Section:
    title: str
    rows: tuple[NameRow, ...]


def _topic(name: str, type_: str, who: str, when: str, *, is_common: bool = False) -> NameRow:
    return NameRow(name, NameKind.TOPIC, type_, who, when, is_common)


def _service(name: str, type_: str, who: str, when: str) -> NameRow:
    return NameRow(name, NameKind.SERVICE, type_, who, when)


OURS = Section(
    "The bench",
    (
        _topic("musselbed/beliefs", "musselbed_msgs/FleetBeliefs", "supervisor", "each tick"),
        _topic("musselbed/apad", "musselbed_msgs/APadStatus", "supervisor", "each tick"),
        _topic("musselbed/mission", "musselbed_msgs/MissionEvent", "supervisor", "each event, as in the bag"),
        _topic(
            "musselbed/forecast",
            "musselbed_msgs/Forecast",
            "supervisor",
            "each tick: the next pick-up, the batch, the mission's end and the aPad's battery then",
        ),
        _topic(
            "musselbed/sound",
            "underwater_msgs/MediumTransmission",
            "supervisor",
            "each packet of sound, by listener",
        ),
        _topic(
            "musselbed/truth",
            "musselbed_msgs/FleetTruth",
            "run.bag",
            "in a run's bag alone, never on the graph",
        ),
        _topic("musselbed/plan", "nav_msgs/Path", "supervisor", "each tick: the plan under way"),
        _topic(
            "musselbed/heartbeat",
            "std_msgs/Float32",
            "supervisor",
            "each tick with an aPad's position of 3 s or younger: its age in seconds; -1 while an OFF is in force",
        ),
        _topic(
            "musselbed/markers",
            "visualization_msgs/MarkerArray",
            "supervisor",
            "each tick: a ball for each aMussel",
        ),
        _topic("musselbed/apad/battery_state", "sensor_msgs/BatteryState", "supervisor", "each tick"),
        _topic("musselbed/apad/fix", "sensor_msgs/NavSatFix", "supervisor", "each tick"),
        _topic("musselbed/apad/path", "nav_msgs/Path", "supervisor", "each tick: the aPad's track so far"),
        _topic(
            "musselbed/claims",
            "musselbed_msgs/FleetClaim",
            "fleets, real or not",
            "1 Hz, latched: the ids that each fleet claims",
            is_common=True,
        ),
        _topic(
            "musselbed/heard",
            "musselbed_msgs/Packet",
            "fleets, real or not",
            "each packet of an aMussel, each range to a real one",
            is_common=True,
        ),
        _topic(
            "musselbed/said",
            "musselbed_msgs/Packet",
            "supervisor",
            "each packet to an aMussel, each ping of a real one",
            is_common=True,
        ),
        _topic(
            "musselbed/felt",
            "musselbed_msgs/Packet",
            "one of several supervisors, or a mission alone",
            "a dock closed around another's aMussel, carried it, or opened",
            is_common=True,
        ),
        _topic(
            "musselbed/dock",
            "musselbed_msgs/DockAlert",
            "supervisor",
            "a dock closed or opened (apad.interface)",
        ),
        _topic(
            "musselbed/dock_by_hand",
            "musselbed_msgs/DockAlert",
            "anybody",
            "a dock that others closed or opened (apad.interface)",
        ),
        _topic(
            "musselbed/permit_surfacing",
            "std_msgs/Int32",
            "anybody",
            "this aMussel may surface (apad.interface)",
        ),
        _topic("musselbed/tell_clear", "std_msgs/Int32", "anybody", "this aMussel may sink (apad.interface)"),
        _service(
            "musselbed/spawn", "musselbed_msgs/SpawnAmussel", "supervisor", "an aMussel enters the water"
        ),
        _service("musselbed/retire", "musselbed_msgs/AmusselById", "supervisor", "an aMussel leaves it"),
        _service("musselbed/hand_over", "musselbed_msgs/AmusselById", "supervisor", "from simulated to real"),
        _service("musselbed/take_back", "musselbed_msgs/AmusselById", "supervisor", "from real to simulated"),
        _service(
            "musselbed/inject_fault",
            "musselbed_msgs/InjectFault",
            "supervisor",
            "a fault of an aMussel or of the aPad",
        ),
    ),
)
OURS_OF_APAD = Section(
    "Mission primitives of either generation",
    (
        _topic("musselbed/{apad}/goto_status", "std_msgs/Int32", "supervisor", "at each change, latched"),
        _topic("musselbed/{apad}/docking_status", "std_msgs/Int32", "supervisor", "at each change, latched"),
        NameRow("musselbed/{apad}/go_to", NameKind.ACTION, "musselbed_msgs/GoTo", "supervisor", "to its end"),
        NameRow(
            "musselbed/{apad}/docking", NameKind.ACTION, "musselbed_msgs/Docking", "supervisor", "to its end"
        ),
        _service(
            "musselbed/{apad}/go_to_point",
            "musselbed_msgs/GoToPoint",
            "supervisor",
            "answers at the next tick",
        ),
        _service(
            "musselbed/{apad}/go_to_position",
            "musselbed_msgs/GoToPosition",
            "supervisor",
            "the same by degrees",
        ),
        _service(
            "musselbed/{apad}/hold_position",
            "musselbed_msgs/HoldPosition",
            "supervisor",
            "answers at the next tick",
        ),
        _service("musselbed/{apad}/dock", "musselbed_msgs/Dock", "supervisor", "answers at the next tick"),
        _service(
            "musselbed/{apad}/undock", "musselbed_msgs/Undock", "supervisor", "answers at the next tick"
        ),
        *(
            _service(f"musselbed/{{apad}}/{name}", "std_srvs/Trigger", "supervisor", "of a mission by hand")
            for name in ("take_over", "give_back")
        ),
        *(
            _service(
                f"musselbed/{{apad}}/{act}",
                it.service,
                "supervisor",
                f"as `musselbed {act.command} RUN`"
                + (", by the stop's number" if "--stop" in it.arguments else ""),
            )
            for act, it in PERSON_ORDERS.items()
            if it.service
        ),
        _service(
            "musselbed/{apad}/read_run",
            "musselbed_msgs/ReadRun",
            "supervisor",
            "a run's files, for `musselbed console` on another machine",
        ),
        _service(
            "musselbed/{apad}/give_order",
            "musselbed_msgs/GiveOrder",
            "supervisor",
            "stop, continue, abort, remark from there",
        ),
    ),
)
OF_AMUSSEL = Section(
    "An aMussel",
    (
        _topic(
            "amussel{id}/position",
            "auv_msgs/NavSts",
            "fleet",
            "10 Hz of the master's time, at most 50 Hz of the wall clock: its newest report, depth positive down",
        ),
        _topic(
            "amussel{id}/battery_level",
            "std_msgs/Float64",
            "fleet",
            "each tick: percent of the battery in use",
        ),
        _topic("amussel{id}/battery_state", "sensor_msgs/BatteryState", "fleet", "each tick: both batteries"),
        _topic("amussel{id}/fix", "sensor_msgs/NavSatFix", "fleet", "each tick"),
        _topic(
            "amussel{id}/position_static", "auv_msgs/NavSts", "aPad, generation A", "20 Hz while it is docked"
        ),
        _topic("amussel{id}/goto_surface", "std_msgs/Bool", "anybody", "true: it may surface"),
        _topic(
            "amussel{id}/charging",
            "std_msgs/Float64",
            "mission alone, or anybody",
            "each tick at a dock: percent points that an aMussel known by topics alone gains; a fleet counts it",
        ),
        _service("amussel{id}/get_battery_level", "misc_msgs/GetChargeInfo", "fleet", "its newest report"),
        _service("amussel{id}/charge_info", "misc_msgs/GetChargeInfo", "fleet", "its newest report"),
        _service("amussel{id}/get_position", "misc_msgs/GetPosition", "fleet", "its newest report"),
        _service(
            "amussel{id}/get_sensory_reading",
            "misc_msgs/GetSensoryReading",
            "fleet",
            "no current: an empty reading",
        ),
        _service("amussel{id}/send_energy", "misc_msgs/SendEnergy", "fleet", "false: it charges at a dock"),
        _service("amussel{id}/surface", "std_srvs/Trigger", "fleet without a mission", "it may surface"),
        _service("amussel{id}/sink", "std_srvs/Trigger", "fleet without a mission", "it may sink"),
    ),
)
_A, _B, _AB = "aPad, generation A", "aPad, generation B", "aPad"
OF_APAD = Section(
    "An aPad, by its own stack",
    (
        _topic("{apad}/position", "auv_msgs/NavSts", _AB, "10 Hz"),
        _topic("{apad}/stateRef", "auv_msgs/NavSts", _AB, "10 Hz; ours also after each time of /clock"),
        _topic("{apad}/battery_level", "std_msgs/Float64", _AB, "1 Hz, percent"),
        *(
            NameRow(f"{{apad}}/LocalOrigin{it}", NameKind.PARAMETER, "double", _AB, "the origin, in degrees")
            for it in ("Lat", "Lon")
        ),
        NameRow("{apad}/action_server", NameKind.ACTION, "apad/aPad", _A, "go to, perch, release"),
        _topic("{apad}/charging", "std_msgs/Float64", "anybody", "generation A subscribes: percent gained"),
        _topic("{apad}/draining", "std_msgs/Float64", "anybody", "generation A subscribes: percent lost"),
        _service("{apad}/check_docking_availability", "misc_msgs/GetDockingInfo", _A, "which docks are free"),
        _service(
            "{apad}/change_docking_status", "misc_msgs/ChangeDockingStatus", _A, "its result is always false"
        ),
        _service("{apad}/get_battery_level", "misc_msgs/GetChargeInfo", _A, "its battery"),
        _service("{apad}/charge_info", "misc_msgs/GetChargeInfo", _A, "its battery"),
        _service("{apad}/anchor", "std_srvs/Trigger", _A, "hold"),
        _service("{apad}/send_energy", "misc_msgs/SendEnergy", _A, "through a dock's coil"),
        _service("{apad}/FADP_enable", "navcon_msgs/EnableControl", _A, "a controller of its own"),
        _service("{apad}/DEPTH_enable", "navcon_msgs/EnableControl", _A, "a controller of its own"),
        _service("{apad}/VelCon_enable", "navcon_msgs/EnableControl", _A, "a controller of its own"),
        _service(
            "{apad}/ConfigureVelocityController",
            "navcon_msgs/ConfigureVelocityController",
            _A,
            "a controller of its own",
        ),
        _service(
            "{apad}/commander/primitive/go2point", "misc_msgs/Go2pointPrimitiveService", _B, "answers at once"
        ),
        _service(
            "{apad}/commander/primitive/dynamic_positioning",
            "misc_msgs/DynamicPositioningPrimitiveService",
            _B,
            "answers at once",
        ),
        _service(
            "{apad}/commander/primitive/docking", "misc_msgs/DockingPrimitiveService", _B, "answers at once"
        ),
        _service(
            "{apad}/commander/go2point", "misc_msgs/Go2pointService", _B, "the same with a radius of 1.5 m"
        ),
        _service(
            "{apad}/commander/docking", "misc_msgs/DockingService", _B, "the same with rates of its own"
        ),
        NameRow(
            "{apad}/go2point",
            NameKind.ACTION,
            "navcon_msgs/GoToPoint",
            _B,
            "the layer below: every go-to, to its end",
        ),
        _service("{apad}/commander/stop_mission", "std_srvs/Trigger", _B, "ends the primitive"),
        _service("{apad}/commander/pause_mission", "std_srvs/Trigger", _B, "pauses it"),
        _service("{apad}/commander/continue_mission", "std_srvs/Trigger", _B, "continues it"),
        _topic("{apad}/goto_status", "std_msgs/Int32", _B, "status of the go-to"),
        _topic("{apad}/docking_status", "std_msgs/Int32", _B, "status of the docking"),
        _topic("{apad}/eventString", "std_msgs/String", _B, "a primitive ended"),
        _topic(
            "{apad}/dock_out", "std_msgs/Float32MultiArray", f"{_B}, and the supervisor", "the docks' arms"
        ),
        _topic("{apad}/kinect_out", "std_msgs/Float32", _B, "the camera's servo"),
        _topic("{apad}/manual", "std_msgs/Bool", "its pilot", "whether a person steers"),
        _topic("{apad}/watchdog", "std_msgs/String", "launch_scripts/vehicle_watchdog", "2 Hz: its state"),
        _topic(
            "{apad}/watchdog_settings",
            "std_msgs/String",
            "launch_scripts/vehicle_watchdog",
            "2 Hz: its `heartbeat` topic and its `silence_s`, as JSON",
        ),
        _topic(
            "{apad}/docking_horizontal",
            "std_msgs/Float32",
            "its camera, or ours",
            "each image with an aMussel in it",
        ),
        _topic(
            "{apad}/docking_vertical",
            "std_msgs/Float32",
            "its camera, or ours",
            "each image with an aMussel in it",
        ),
        _topic("{apad}/size", "std_msgs/Float32", "its camera, or ours", "each image with an aMussel in it"),
    ),
)
GLOBAL = Section(
    "Global, whatever the namespace",
    (
        _topic(CLOCK, "rosgraph_msgs/Clock", "one node of a master", "a master has one time"),
        _topic(
            CLOCK_REACHED,
            "rosgraph_msgs/Clock",
            "simulated aPad, supervisor",
            "after each time of /clock or tick, latched: all before is handled; the one /clock waits for it",
        ),
        NameRow(
            USE_SIM_TIME,
            NameKind.PARAMETER,
            "bool",
            "who starts the clock",
            "rospy reads it there and nowhere else",
        ),
        _topic(
            TF,
            "tf2_msgs/TFMessage",
            "supervisor",
            "each tick; a master has one tree, so frames carry the namespace",
        ),
        _topic(TF_STATIC, "tf2_msgs/TFMessage", "supervisor", "once, latched; the same tree"),
        _topic(
            DIAGNOSTICS,
            "diagnostic_msgs/DiagnosticArray",
            "supervisor",
            "each tick; aggregators and rqt subscribe there",
        ),
        _topic(
            BATTERY_ALERT,
            "auv_msgs/NavSts",
            "fleet",
            "an aMussel reported a low charge; the legacy stack's broadcast, `header.frame_id` names the aMussel",
        ),
    ),
)
SECTIONS = (OURS, OURS_OF_APAD, OF_AMUSSEL, OF_APAD, GLOBAL)
