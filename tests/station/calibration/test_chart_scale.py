"""The record of a chart's scale, and what camera.h5 holds of it."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from procedures import BadParameter, GeometryParameters, Verdict
from station.calibration.chart_scale import ChartScale
from station.calibration.geometry import GeometryPhotographs, ViewRecord, conclude
from station.calibration.geometry_files import geometry_measurement
from station.procedure.builtin.geometry import GeometrySettings
from station.results.measurement import write_measurement
from station.results.record_head import RecordHead, files_read
from station.results.result_files import ResultFolder
from tests.procedures.geometry.simulated_views import CELL_MM, Shoot, TrueCamera, take

MANUAL = Path(__file__).resolve().parents[3] / "station" / "manual" / "reference" / "files.md"
TEXT = """
width_mm = 300.0
reading_uncertainty_mm = 0.03
ruler = "steel rule"
certificate = "D-K 1"
ruler_uncertainty_mm = 0.04
measured_at_c = 30
used_at_c = 20
expansion_per_k = 2e-5
ruler_expansion_per_k = 1e-5
temperature_uncertainty_c = 0
"""


@pytest.fixture
def file(tmp_path) -> Path:
    path = tmp_path / "scale.toml"
    path.write_text(TEXT)
    return path


def test_ruler_and_chart_expand_by_the_record_of_a_certificate(file):
    scale = ChartScale.read(file)
    # the ruler was 1e-4 too long, the chart shrinks by 2e-4 until it is used
    assert scale.used_width_mm == pytest.approx(300 * (1 + 1e-4) * (1 - 2e-4), abs=1e-9)
    # 0.03 and 0.04 mm, and a tenth of expansions of 0.03 and 0.06 mm
    assert scale.uncertainty_mm == pytest.approx(np.sqrt(0.03**2 + 0.04**2 + 0.003**2 + 0.006**2))
    parameters = GeometrySettings(scale=file).parameters
    assert parameters.cell_mm * 320 == pytest.approx(ChartScale.read(file).used_width_mm)
    assert parameters.scale_uncertainty == pytest.approx(ChartScale.read(file).uncertainty_mm / 300, rel=1e-3)
    file.write_text(TEXT.replace('certificate = "D-K 1"', ""))
    with pytest.raises(BadParameter, match="certificate is missing"):
        ChartScale.read(file)


def test_a_script_of_ten_lines_reads_camera_numbers_budget_and_scale(file, tmp_path, monkeypatch, capsys):
    taken = take(Shoot(TrueCamera(thin_prism=(0.0,) * 4), count=6, every=4), np.random.default_rng(12))
    records = tuple(ViewRecord(Path(view.source), f"{n:064}", view, Verdict.PASS) for n, view in enumerate(taken.views))
    monkeypatch.setattr("procedures.geometry.estimate.chart_nodes", lambda cell_mm: taken.nodes)
    planes = conclude([GeometryPhotographs("Y", (6000, 4000), records)], GeometryParameters(CELL_MM))
    head = RecordHead("geometry", files_read(records), {})
    with ResultFolder(tmp_path / "out") as folder:
        write_measurement(folder, geometry_measurement(planes, head, ChartScale.read(file)))
    script = re.search(r"reads it:\n\n```python\n(.*?)```", MANUAL.read_text(), re.S)[1]
    (tmp_path / "script.py").write_text(script)
    monkeypatch.chdir(tmp_path / "out")
    read = runpy.run_path(str(tmp_path / "script.py"))
    printed = capsys.readouterr().out
    assert "STEREOGRAPHIC+SPLINE" in printed
    assert '"certificate": "D-K 1"' in printed
    geometry = planes[0].outcome.result()
    assert read["camera"]["geometry.fx"][0] == geometry.camera.params[0]
    for name, terms in geometry.budgets().items():
        number = geometry.numbers()[name]
        stated = number.value if name.startswith("projection") else number.uncertainty
        # the map of a projection's uncertainty has a finer grid than the budget
        assert np.linalg.norm(list(terms.values())) == pytest.approx(stated, rel=0.1), name
    simple = GeometryParameters(CELL_MM, model="SIMPLE_RADIAL")
    planes = conclude([GeometryPhotographs("Y", (6000, 4000), records)], simple)
    assert "k1" in planes[0].outcome.result().budgets()
