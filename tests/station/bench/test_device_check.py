"""Wrong station.toml files: each refused with key, value, line and remedy, in words that are not Python's."""

import re
import string
import tomllib

import pytest

from drivers.errors import BadConfiguration
from station.bench.device_models import BUILTIN, options_of
from station.bench.opening import make_bench, read_config
from station.common.models import fields_of, is_model
from station.common.toml_text import line_of
from tests.program import run

DEVICES = {
    "stage": "grbl", "head": "zaber", "shutter": "strig", "camera": "folder", "tether": "gphoto", "relay": "relay",
    "fast": "fast", "light": "dmx", "microscope": "micromanager_stage", "door": "micromanager_shutter",
    "scope_camera": "micromanager_camera", "machine_vision": "genicam", "shaker": "strig_shaker",
    "watchdog": "strig_watchdog", "lamp": "grbl_light", "node": "artnet", "dome": "alpaca_light",
}  # fmt: skip
DEVICES |= {driver: driver for driver in BUILTIN if driver not in DEVICES.values()}
"""A device of every driver, all of its options as their examples have them."""


def examples(model):
    written = {one.name: examples(one.kind) if is_model(one.kind) else one.example for one in fields_of(model)}
    return {name: value for name, value in written.items() if value}


def good(name, driver):
    table = {"driver": f'"{driver}"', **examples(options_of(driver))}
    if "on" in table:
        del table["port"]
    elif "port" in table:
        table["port"] = f'"/dev/{name}"'
    return table


GOOD = {name: good(name, driver) for name, driver in DEVICES.items()}

NO_NUMBER = ['"fast"', "true", "nan", "inf", "[1]", "{a = 1}"]
ABOVE_0 = ["0", "-1", *NO_NUMBER]
NOT_BELOW_0 = ["-0.5", *NO_NUMBER]
WHOLE = ["0", "-3", "1.5", "true", '"1"', "100000000"]
TEXT = ["3", "true", '""', "[1]"]
WRONG = {
    "stage": {
        "port": TEXT,
        "baud": WHOLE,
        "poll_s": [*ABOVE_0, "60"],
        "reset_on_open": ['"avoidd"', "true", "1", '""'],
        "axes": {
            "name": ['"z"', '"Z_mm"', '"z_inch"', '""', "3"],
            "letter": ['"x"', '"Q"', "1", '"XY"'],
            "feed_per_min": ABOVE_0,
            "origin": NO_NUMBER,
            "direction": ["2", "0", "1.0", "true", '"up"'],
            "travel": ABOVE_0,
            "space": ["[0, -300]", "[0]", "300", '["a", "b"]', "[0, nan]", "[1, 1]"],
        },
    },
    "head": {
        "baud": WHOLE,
        "axes": {
            "name": ['"pan"', "1"],
            "device": [*WHOLE, "100"],
            "axis": [*WHOLE, "10"],
            "unit_per_step": ABOVE_0,
            "zero": NO_NUMBER,
            "speed_per_s": ABOVE_0,
        },
    },
    "shutter": {"driver": ['"strigg"', "1", '""'], "port": TEXT},
    "camera": {
        "folder": TEXT,
        "shutter": ['"box"', '"stage"', "1", '"camera"'],
        "pulse_s": ABOVE_0,
        "bulb": ["1", '"yes"'],
        "rest_s": NOT_BELOW_0,
        "focus_s": NOT_BELOW_0,
        "poll_s": [*ABOVE_0, "6"],
        "patience_s": ABOVE_0,
    },
    "tether": {"shutter": ['"head"', "false"], "model": TEXT},
    "microscope": {
        "config": TEXT,
        "patience_s": ABOVE_0,
        "axes": {
            "device": TEXT,
            "part": ['"z"', '"X"', "1"],
            "travel": ["[100, 0]", "[1]", "100"],
            "unit_per_um": ABOVE_0,
            "direction": ["0", "true"],
            "homes": ["1", '"no"'],
            "tolerance": ABOVE_0,
        },
    },
    "door": {"device": TEXT},
    "shaker": {"box": ['"relay"', '"box"', "1"], "axes": {"channel": ["2", "true", "0.0"], "stroke": ABOVE_0}},
    "watchdog": {"box": ['"relay"'], "stages": ["[]", "[1]", '["head"]', '["rail"]', '["stage", "stage"]']},
    "machine_vision": {
        "camera": TEXT,
        "pixel_format": ['"RGB8"', '"mono8"', "8"],
        "gain_db": NO_NUMBER,
        "patience_s": ABOVE_0,
    },
    "scope_camera": {
        "mosaic": ['"rggb"', '"RGB"', "true"],
        "f_number": ABOVE_0,
        "black": NOT_BELOW_0,
        "pixel_pitch_um": ABOVE_0,
        "lens": TEXT,
    },
    "relay": {"on": ['"rail"', '"head"', "2"]},
    "node": {"host": [*TEXT, '"node:65536"']},
    "dome": {"server": [*TEXT, '"127.0.0.1"', '"[::1]:65536"']},
    "fast": {"full_scale_g": ABOVE_0, "full_scale_deg_s": ABOVE_0},
    "light": {
        "channels": ["[]", "[0]", "[513]", "true", "[1, 1]", '["a"]', "[1.5]"],
        "warm_up_s": NOT_BELOW_0,
        "pwm_hz": NOT_BELOW_0,
    },
}
PYTHON = re.compile(r"\b(None|True|False|dict|float|int|str|list object|tuple|\w*Error|Traceback|argument|self)\b")


def text_of(tables):
    """The file, axes as tables on one line, and nowhere a key before its table."""
    rows = []
    for name, table in tables.items():
        rows.append(f"[devices.{name}]  # a remark = 1")
        for key, value in table.items():
            if isinstance(value, dict):
                value = "[\n    { " + ", ".join(f"{k} = {v}" for k, v in value.items()) + " },\n]"
            rows.append(f"{key} = {value}")
        rows.append("")
    return "\n".join(rows)


def spoilt(name, key, value):
    tables = {one: dict(table) for one, table in GOOD.items()}
    if isinstance(key, tuple):
        tables[name]["axes"] = GOOD[name]["axes"] | {key[1]: value}
    else:
        tables[name][key] = value
    return text_of(tables)


def cases():
    for name, keys in WRONG.items():
        for key, values in keys.items():
            if isinstance(values, dict):
                yield from ((name, ("axes", one), value) for one, wrong in values.items() for value in wrong)
            else:
                yield from ((name, key, value) for value in values)


def refusal(tmp_path, text):
    path = tmp_path / "station.toml"
    path.write_text(text)
    with pytest.raises(BadConfiguration) as refused:
        read_config(path)
    return refused.value


def test_the_good_file_is_good(tmp_path):
    path = tmp_path / "station.toml"
    tables = {name: dict(table) for name, table in GOOD.items()}
    for letter, table in zip(string.ascii_lowercase, (one for one in tables.values() if "axes" in one), strict=False):
        table["axes"] = table["axes"] | {"name": f'"{letter}_mm"'}
    path.write_text(text_of(tables))
    bench = make_bench(read_config(path), folder=tmp_path)
    assert set(bench.devices) == set(GOOD)


def test_there_are_two_hundred():
    assert len(list(cases())) >= 200


@pytest.mark.parametrize(("name", "key", "value"), list(cases()))
def test_a_wrong_value_is_refused_with_key_value_line_and_remedy(tmp_path, name, key, value):
    text = spoilt(name, key, value)
    error = refusal(tmp_path, text)
    word = key[1] if isinstance(key, tuple) else key
    start = text.index(f"[devices.{name}]")
    line = text.count("\n", 0, text.index(f"{word} = {value}", start)) + 1
    assert f"station.toml, line {line}: devices.{name}" in error.reason
    assert word in error.reason
    assert value in error.reason
    assert error.remedy.split()[0] in ("write", "use", "add", "name", "give", "begin")
    assert not PYTHON.search(error.reason.replace(value, "") + error.remedy)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "configures no devices; add tables like"),
        ("devices = 3", "configures no devices"),
        ('unit = "lp/mm"\n[device.stage]\ndriver = "grbl"', "line 2: device is not known; write devices"),
        ("[devices]\nstage = 3", r"line 2: devices.stage must be a table; it is 3; begin one with \[devices.stage\]"),
        ("[devices.stage", "is not valid TOML: .*; correct that line"),
        ("[devices.stage]\ndriver = grbl", "is not valid TOML: .*line 2"),
        ('[devices.stage]\ndriver = "grbl"\ndriver = "grbl"\n', "is not valid TOML: .*line 3"),
        ('[devices.stage]\nport = "/dev/x"', "line 1: devices.stage.driver is missing; use one of"),
        (
            '\n[devices.stage]\ndriver = "grlb"',
            'line 3: .*driver must be the name of a driver; it is "grlb"; write .*"grbl"',
        ),
        ('[devices.stage]\ndriver = "grbl"\nport = "x"', r"line 1: .*axes is missing; write axes = \[\{ name"),
        (
            '[devices.stage]\ndriver = "grbl"\nport = "x"\naxes = []',
            r"line 4: devices.stage.axes must be a list of tables with .*row; it is \[\]",
        ),
        (
            '[devices.stage]\ndriver = "grbl"\nport = "x"\naxes = [{ nom = "z" }]',
            r"line 4: .*axes\[1\].nom is not known; use one of",
        ),
        ('[devices.stage]\ndriver = "grbl"\nport = "x"\naxes = [{ name = "z_mm" }]', r"\[1\].letter is missing"),
        ('[devices.light]\ndriver = "dmx"\nport = "x"\ncolour = 1', "line 4: devices.light.colour is not known"),
        ('[devices.light]\ndriver = "dmx"\nport = "x"\nchanels = [1]', "write channels"),
        ('[devices.light]\ndriver = "dmx"', 'port is missing; write port = "/dev/ttyUSB0"'),
        ('[devices.light]\ndriver = "grbl_light"', "devices.light has neither port nor on"),
        (
            '[devices.a]\ndriver = "wit"\nport = "x"\n[devices.b]\ndriver = "jrt"\nport = "x"',
            'line 6: devices.b.port must differ; "x" is already given to a',
        ),
        ('[devices.light]\ndriver = "grbl_light"\non = "stage"\nport = "x"', "devices.light has both port and on"),
        ('[devices."../a"]\ndriver = "rts"\nport = "x"', "must have a name of at most 64 letters"),
        ('[devices.a]\ndriver = "relay"\non = "b"\n[devices.b]\ndriver = "relay"\non = "a"', "b is not a GRBL stage"),
    ],
)
def test_a_file_that_lacks_or_muddles_something(tmp_path, text, complaint):
    path = tmp_path / "station.toml"
    path.write_text(text)
    with pytest.raises(BadConfiguration, match=complaint) as refused:
        read_config(path)
    assert not PYTHON.search(str(refused.value))


@pytest.mark.parametrize(
    ("key", "value", "reported"),
    [("name", '"z_mm"', 'name = "z_mm" is given twice'), ("letter", '"X"', 'letter = "X" is given twice')],
)
def test_two_axes_are_not_one(tmp_path, key, value, reported):
    second = {"name": '"x_mm"', "letter": '"Y"', "feed_per_min": "1"} | {key: value}
    axis = "{ " + ", ".join(f"{k} = {v}" for k, v in second.items()) + " }"
    first = '{ name = "z_mm", letter = "X", feed_per_min = 1 }'
    text = f'[devices.stage]\ndriver = "grbl"\nport = "x"\naxes = [\n  {first},\n  {axis},\n]\n'
    error = refusal(tmp_path, text)
    assert error.reason == f"station.toml, line 6: devices.stage.axes[2].{key} must differ; {reported}"


@pytest.mark.parametrize(
    ("table", "complaint"),
    [
        ("[devices.light]", "devices.light must have a driver that serves as light; zaber does not"),
        ("[devices.head]", "different names; stage and head have z_mm; rename one"),
    ],
)
def test_a_device_serves_what_its_name_says_and_no_axis_has_two_stages(tmp_path, table, complaint):
    stage = '[devices.stage]\ndriver = "zaber"\nport = "x"\naxes = [{ name = "z_mm", device = 1, unit_per_step = 1 }]\n'
    path = tmp_path / "station.toml"
    path.write_text(stage + stage.replace("[devices.stage]", table).replace('"x"', '"y"'))
    with pytest.raises(BadConfiguration, match=complaint):
        make_bench(read_config(path), folder=tmp_path)


def test_the_command_reports_it_without_a_traceback(tmp_path):
    path = tmp_path / "station.toml"
    path.write_text(spoilt("stage", ("axes", "feed_per_min"), "0"))
    done = run("devices", "--config", path, code=2)
    assert "devices.stage.axes[1].feed_per_min must be a number above 0; it is 0" in done.stderr
    assert "write feed_per_min = 1500" in done.stderr
    assert "Traceback" not in done.stderr


def test_lines_are_found_among_strings_remarks_and_nested_tables():
    text = '''# [devices.no]
title = """
[devices.fake]
key = 1"""
a."b c".d = [ 1, # two = 2
  { e = "}", f = [ 3, 4 ] }, ]

[[rows]]
x = 'it\\'
[[rows]]
  x = "\\"]" # y = 2
y.z = 2026-01-01T00:00:00Z
'''
    assert tomllib.loads(text)["rows"][1]["y"]
    assert line_of(text, ("title",)) == 2
    assert line_of(text, ("a", "b c", "d")) == 5
    assert line_of(text, ("a", "b c", "d", 1, "e")) == line_of(text, ("a", "b c", "d", 1, "f", 1)) == 6
    assert [line_of(text, ("rows", n, "x")) for n in (0, 1)] == [9, 11]
    assert line_of(text, ("rows", 1, "y", "z")) == 12
    assert line_of(text, ("devices", "fake", "key")) is None
