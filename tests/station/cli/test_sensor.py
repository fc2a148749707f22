"""`station sensor`: grey pictures with a manifest, RAW files of the bench's sensor, its files and exit codes."""

import csv
import json
import shutil
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import cv2
import html5lib
import numpy as np
import pytest

from simulators.camera.sensor import Sensor
from tests.golden.cases import shoot_sensor
from tests.program import run

SLOW_FIXTURES = {"bench_sensor"}

ROWS, COLUMNS = 96, 128


@pytest.fixture(scope="module")
def bench_sensor() -> Sensor:
    return Sensor(rows=ROWS, columns=COLUMNS, prnu=0.01, read_noise_e=12.0, gain_e_per_dn=2.6)


@pytest.fixture(scope="module")
def raw_folder(tmp_path_factory, bench_sensor):
    """DNG files of dark pictures and even light, as a camera on the bench writes them."""
    return shoot_sensor(tmp_path_factory.mktemp("raw"), bench_sensor, 24, 18)


def test_the_bench_sensor_is_recovered_from_raw_files(raw_folder, bench_sensor, tmp_path):
    run("sensor", raw_folder, "--no-report", "--out", tmp_path / "out")
    record = json.loads((tmp_path / "out" / "result.json").read_text())
    assert record["schema"] == "station/sensor/1"
    assert list(record["planes"]) == ["R", "G1", "G2", "B"]
    for name, plane in record["planes"].items():
        assert plane["verdict"] == "pass", (name, plane["reason"])
        for number, truth in (("inverse_gain", 2.6), ("temporal_dark_noise", 12.0)):
            one = plane[number]
            # eight of them: three standard uncertainties
            assert abs(one["value"] - truth) < 3 * one["uncertainty"], (name, number, one)
            assert one["interval"][0] < one["value"] < one["interval"][1]
        assert plane["prnu"]["value"] == pytest.approx(1.0, rel=0.06)  # 3072 pixels: 1 / sqrt(2 n) is 1.3 %
        assert plane["model"]["dark_level"] == pytest.approx(512, abs=0.3)
    assert "quantum_efficiency" not in record["planes"]["R"]  # photons are not known
    # full wells of 40000 electrons clip pixels of more response, and the noise of all, some standard deviations before
    low, high = record["planes"]["G1"]["saturation_capacity"]["interval"]
    assert low < 40000
    assert high > 0.97 * 40000


def test_all_files_are_written_and_agree(raw_folder, tmp_path):
    run("sensor", raw_folder, "--plane", "G1", "--out", tmp_path)
    record = json.loads((tmp_path / "result.json").read_text())
    gain = record["planes"]["G1"]["system_gain"]["value"]
    assert set(record["files"]) == {
        "numbers.csv", "emva1288.xml", "report.html", "transfer_G1.csv", "spectrogram_G1.csv", "histogram_G1.csv",
        "defects_G1.csv", "nps_G1.npy",
    }  # fmt: skip
    rows = {row["number"]: row for row in csv.DictReader((tmp_path / "numbers.csv").read_text().splitlines())}
    assert float(rows["system_gain"]["value"]) == pytest.approx(gain, rel=1e-8)
    assert rows["system_gain"]["unit"] == "DN/e-"
    tree = ElementTree.parse(tmp_path / "emva1288.xml")
    assert float(tree.findtext("plane/sensitivity/system_gain/value")) == pytest.approx(gain, rel=1e-8)
    assert {section.tag for section in tree.find("plane")} == {
        "sensitivity", "linearity", "dark_current", "spatial", "defect_pixel", "general",
    }  # fmt: skip
    # white noise: the mean of its spectrum is the variance, known to some 2 over the root of the samples
    noise = np.load(tmp_path / "nps_G1.npy", allow_pickle=False)
    variance = gain * record["planes"]["G1"]["noise_power"]["signal"] + (12 / 2.6) ** 2
    assert noise.mean() == pytest.approx(
        variance, rel=4 * 2 / (1024 * record["planes"]["G1"]["noise_power"]["blocks"]) ** 0.5
    )
    page = (tmp_path / "report.html").read_text()
    parsed = html5lib.HTMLParser(strict=True, namespaceHTMLElements=False).parse(page)
    assert len(parsed.findall(".//figure")) == 11
    counts = [int(row["count"]) for row in csv.DictReader((tmp_path / "histogram_G1.csv").read_text().splitlines())]
    assert sum(counts) == 2 * ROWS * COLUMNS // 4


@pytest.fixture
def grey(tmp_path):
    """A folder of grey pictures, two of each level, and its manifest; returns what writes one more."""
    folder = tmp_path / "grey"
    folder.mkdir()
    rng = np.random.default_rng(0)
    sensor = Sensor(rows=40, columns=48, cfa=None, bits=12, black=(64,) * 4, gain_e_per_dn=9.0, read_noise_e=20.0)
    lines = ["file,kind,exposure_s,light"]

    def write(kind: str, light: float, sensor: Sensor = sensor, count: int = 2) -> None:
        for _ in range(count):
            name = f"p{len(lines):03d}.png"
            shape = (sensor.rows, sensor.columns)
            cv2.imwrite(str(folder / name), sensor.expose(np.full(shape, light), 36000, rng))
            lines.append(f"{name},{kind},0.01,{light or ''}")
            (folder / "sensor.csv").write_text("\n".join(lines) + "\n")

    write.folder, write.sensor = folder, sensor
    return write


def ladder(write, top: float) -> None:
    write("dark", 0.0)
    for light in np.linspace(0.03, top, 22):
        write("light", round(float(light), 4))


@pytest.mark.slow
def test_grey_pictures_without_stacks_give_what_they_can(grey, tmp_path):
    ladder(grey, 1.2)
    run("sensor", grey.folder, "--out", tmp_path / "out")
    plane = json.loads((tmp_path / "out" / "result.json").read_text())["planes"]["Y"]
    assert plane["verdict"] == "doubtful"
    assert "without a dark and flat stack" in plane["reason"]
    gain = plane["inverse_gain"]
    assert abs(gain["value"] - 9.0) < 3 * gain["uncertainty"]
    assert "dsnu" not in plane


@pytest.mark.slow
def test_left_aligned_samples_give_digital_numbers_of_the_converter(grey, tmp_path):
    ladder(grey, 1.2)
    for path in grey.folder.glob("*.png"):
        cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_UNCHANGED) * 16)
    run("sensor", grey.folder, "--out", tmp_path / "out")
    plane = json.loads((tmp_path / "out" / "result.json").read_text())["planes"]["Y"]
    assert plane["inverse_gain"]["value"] == pytest.approx(9.0, rel=0.1)
    assert plane["model"]["gain"] == pytest.approx(16 * plane["system_gain_at_dark"]["value"])


def test_ladder_without_saturation_is_refused(grey, tmp_path):
    ladder(grey, 0.7)
    run("sensor", grey.folder, "--out", tmp_path / "out", code=5)
    plane = json.loads((tmp_path / "out" / "result.json").read_text())["planes"]["Y"]
    assert (plane["verdict"], "beyond saturation" in plane["reason"]) == ("refused", True)
    assert plane["remedy"]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (lambda write: write("light", 0.5, replace(write.sensor, rows=50)), "of one size"),
        (lambda write: write("light", 0.55, count=1), "temporal noise needs two"),
        (lambda write: shutil.copy(write.folder / "p003.png", write.folder / "p004.png"), "has the content of"),
    ],
    ids=["two sizes", "a single picture of a level", "a copy"],
)
def test_inconsistent_pictures_are_refused(grey, tmp_path, more, words):
    ladder(grey, 1.2)
    more(grey)
    run("sensor", grey.folder, "--out", tmp_path / "out", code=4, says=words)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_an_unreadable_picture_excludes_its_level(grey, tmp_path):
    ladder(grey, 1.2)
    lost, alone = (grey.folder / name for name in ("p007.png", "p008.png"))  # a pair of the ladder
    lost.write_bytes(lost.read_bytes()[:100])
    done = run("sensor", grey.folder, "--out", tmp_path / "out", code=1, says=f"warning: {lost} ")
    assert f"{alone} is the only readable picture" in done.stderr
    record = json.loads((tmp_path / "out" / "result.json").read_text())
    assert [one["source"] for one in record["left_out"]] == [str(lost), str(alone)]
    gain = record["planes"]["Y"]["inverse_gain"]
    assert abs(gain["value"] - 9.0) < 3 * gain["uncertainty"]
    assert "p008.png is the only readable picture" in (tmp_path / "out" / "report.html").read_text()


def test_the_readable_part_of_a_ladder_must_suffice(grey, tmp_path):
    ladder(grey, 1.2)
    lost = [path for path in sorted(grey.folder.glob("*.png"))[2:] if int(path.stem[1:]) % 3 == 0]
    for path in lost:
        path.write_bytes(b"no picture")
    run("sensor", grey.folder, "--out", tmp_path / "out", code=5)
    plane = json.loads((tmp_path / "out" / "result.json").read_text())["planes"]["Y"]
    assert "the ladder needs at least 8 levels of light" in plane["reason"]
    assert f"of 46 photographs cannot be used, {lost[0]} is a text file" in plane["reason"]


def test_a_folder_without_a_readable_picture_is_refused(tmp_path):
    for kind in ("dark", "light"):
        (tmp_path / kind).mkdir()
        (tmp_path / kind / "a.dng").write_bytes(b"no picture")
    run("sensor", tmp_path, "--out", tmp_path / "out", code=4, says="none of 2 photographs can be used")
