"""A sensor's gain, noise, linearity, dark current and non-uniformity: EMVA 1288."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

from procedures.outcome import Miss
from station.calibration.folder_photographs import PHOTOGRAPHS
from station.calibration.sensor import measure_sensor
from station.calibration.sensor_files import sensor_measurement
from station.calibration.sensor_folder import find_shots
from station.common.progress import Progress
from station.procedure.base import Inputs, Procedure, Settings, setting, upper_plane
from station.results.measurement import Measurement
from station.results.record_head import RecordHead


class SensorSettings(Settings, frozen=True, kw_only=True):
    """Which planes."""

    plane: Annotated[str, setting("R, G1, G2, B, Y or all.")] = "all"


class SensorCharacterisation(Procedure[SensorSettings]):
    """Dark pictures and a ladder of even light."""

    name = "sensor"
    title = "EMVA 1288 release 4.0, linear and general model"
    help = """Measure gain, noise, linearity, dark current and non-uniformity of a sensor, each with its 95 % interval.

    EMVA 1288 release 4.0, linear and general model, of every plane of a mosaic by itself.

    FOLDER holds dark pictures and pictures of even light, two or more of each exposure; three or more of one exposure
    are a stack. A manifest in it assigns them:

    \b
    sensor.csv    file,kind,exposure_s,photons
                  d1.png,dark,0.01,
                  a1.png,light,0.01,1500
    sensor.toml   [[level]]
                  kind = "light"
                  exposure_s = 0.01
                  photons = 1500
                  files = ["a1.png", "a2.png"]

    "photons" are photons per pixel, for the quantum efficiency; "light", any number proportional to them, is enough
    where they are not known; with neither, light is proportional to the exposure time. The descriptor of an EMVA 1288
    data set (lines "b", "d", "i") is read as well. Without a manifest, RAW files in FOLDER/dark and FOLDER/light are
    sorted by the exposure time that the camera noted."""
    inputs = Inputs.FOLDER
    Settings = SensorSettings
    drawn_by = "sensor_page:sensor_page"
    suffixes = PHOTOGRAPHS | {"sensor.csv", "sensor.toml", ".txt"}  # the manifests are parts of an item
    method = "EMVA Standard 1288, release 4.0"

    def steps(self, paths: Sequence[Path]) -> int:
        return sum(len(shot.paths) for shot in find_shots(paths[0], lambda miss: None))

    def measured(self, paths: Sequence[Path], settings: SensorSettings, progress: Progress) -> Measurement:
        missed: list[Miss] = []
        shots, plane = find_shots(paths[0], missed.append), upper_plane(settings.plane)

        def reported(pictures: Iterator[Path]) -> Iterator[Path]:
            for path in pictures:
                yield path
                progress(f"read {path}")

        result = measure_sensor(shots, plane, reported, missed=missed)
        head = RecordHead(self.name, tuple(result.files), {"folder": str(paths[0]), "plane": plane or "all"})
        return sensor_measurement(result, head)
