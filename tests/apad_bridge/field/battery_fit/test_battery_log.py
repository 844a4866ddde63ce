"""Tests reading logs in users' formats, and the one line for each log that cannot be read."""

from pathlib import Path

import pytest

from apad_bridge.field.battery_fit.battery_log import BatteryLog, LogError, LogFormat, read_log
from apad_bridge.scenario.errors import UserError


def read(tmp_path: Path, text: str, **how: object) -> BatteryLog:
    path = tmp_path / "a.csv"
    path.write_text(text)
    return read_log(path, LogFormat(**how))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "how"),
    [
        ("time_s,voltage_mv\n0,3600\n60,3900\n150,4200\n", {}),
        ("time_min,voltage_v\n0,3.6\n1,3.9\n2.5,4.2\n", {}),
        ("Minutes,Battery [V]\n7,3.6\n8,3.9\n9.5,4.2\n", {}),
        ("time (h),soc (%)\n0,0\n0.0166666666667,50\n0.0416666666667,100\n", {}),
        ("stamp;u\n2026-05-01T23:59:00;0\n2026-05-02T00:00:00;0,5\n2026-05-02T00:01:30;1\n", {}),
        ("2026-05-01 12:00:00+02:00\t3600\n2026-05-01 10:01:00+00:00\t3900\n2026-05-01T10:02:30Z\t4200\n", {}),
        ("# from the lab\n\nelapsed_ms,battery\n0,0.0\n60000,0.5\n150000,1.0\n", {}),
        ("%time,field.data\n1000000000,0\n61000000000,50\n151000000000,100\n", {"value_unit": "percent"}),
        ("0,3600\n1,3900\n2.5,4200\n", {"time_unit": "min"}),
        ("a,b,c\n1,0,0\n1,1,0.5\n1,2.5,1\n", {"time_column": "b", "value_column": "c", "time_unit": "min"}),
        ("time_min,primary_mv,secondary_mv\n0,3000,1\n1,3500,1\n2.5,4000,1\n",
         {"value_column": "primary_mv", "empty_mv": 3000.0, "full_mv": 4000.0}),
        ("time_min,voltage_mv,note\n0,3600,on\n1,3900,\n2,,no reading\n2.5,4200,\n", {}),
    ],
)  # fmt: skip
def test_every_form_of_a_log_says_the_same(tmp_path: Path, text: str, how: dict[str, object]) -> None:
    log = read(tmp_path, text, **how)
    assert (log.minutes, log.scaled) == (pytest.approx([0, 1, 2.5]), pytest.approx([0, 0.5, 1]))
    assert log.left_out == text.count("no reading")


@pytest.mark.parametrize(
    ("text", "how", "message"),
    [
        ("", {}, "holds no rows"),
        ("time_s,u\n", {}, "no rows with a value"),
        ("time_s,u\n0,\n1,nan\n", {}, "no rows with a value"),
        ("time,voltage_mv\n0,3600\n", {}, "does not state the unit of its time"),
        ("time_s,u\n0,0.1\n1,x\n", {}, "line 3: 'x' is no number"),
        ("time_s,u\n0,0.1\nsoon,0.2\n", {}, "line 3: 'soon' is no number"),
        ("time,u\n2026-05-01,0.1\n7,0.2\n", {}, "line 3: '7' is no ISO time stamp"),
        (
            "time,u\n2026-05-01T00:00,0.1\n2026-05-01T00:01Z,0.2\n",
            {},
            "line 3: .* with and without a time zone",
        ),
        ("time_s,u\n0,0.1\n2,0.2\n1,0.3\n", {}, "line 4: time goes back"),
        ("time_s,u\n0,0.1\n2\n", {}, "line 3: has 1 columns only"),
        ("0\n1\n", {}, "has one column only, and a log needs two"),
        ("voltage\n1\n2\n", {}, "has one column only, and a log needs two"),
        (
            "time_s,battery\n0,3.7\n1,55\n",
            {},
            "does not state the unit of its values, which run from 3.7 to 55",
        ),
        ("time_s,primary,secondary\n0,1,1\n", {}, "primary, secondary: choose one with --value-column"),
        ("a,b,c\n0,1,1\n", {}, "no column looks like time: choose one with --time-column: a, b, c"),
        (
            "time_s,b,c\n0,1,1\n",
            {},
            "looks like a battery's voltage or charge: choose one with --value-column",
        ),
        ("a,b\n0,1\n", {"time_column": "t"}, "no column is called 't'; there are a, b"),
    ],
)
def test_a_log_that_cannot_be_read_is_one_line_that_says_why(
    tmp_path: Path, text: str, how: dict[str, object], message: str
) -> None:
    with pytest.raises(LogError, match=message) as raised:
        read(tmp_path, text, **how)
    assert str(raised.value).startswith(str(tmp_path / "a.csv"))
    assert "\n" not in str(raised.value)


def test_a_file_that_is_not_there_or_no_text_is_said(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="No such file"):
        read_log(tmp_path / "no.csv", LogFormat())
    (tmp_path / "x.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UserError, match="is not UTF-8 text"):
        read_log(tmp_path / "x.csv", LogFormat())


def test_a_quotation_mark_that_is_not_closed_is_one_line(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text('time_s,voltage_v\n0,"4.2\n' + "60,4.1\n" * 20)
    with pytest.raises(LogError, match=r"log\.csv: line 2: .*quotation mark"):
        read_log(log, LogFormat())
