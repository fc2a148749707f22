"""A library of measured fields: one file each in a folder, with camera, lens, aperture and focus in it."""

import os
import re
import shutil
from dataclasses import dataclass
from pathlib import Path

from procedures.correction.checks import check_exposure
from procedures.field.field_file import read_camera, set_camera
from procedures.outcome import BadInput, BadParameter, Refused
from procedures.raw import Exposure
from station.calibration.exports.psf import field_path
from station.common.durable_files import written

ENVIRONMENT = "STATION_PROFILES"
KEY = ("camera", "lens", "f_number")
"""Fields of the key; focal length and focus distance belong to it where they are recorded."""


@dataclass(frozen=True)
class Profile:
    """A field of the library; unknown : what could not be compared with the settings asked for."""

    path: Path
    exposure: Exposure
    unknown: tuple[str, ...] = ()

    def record(self) -> dict[str, object]:
        """For JSON."""
        one = self.exposure
        return {
            "path": str(self.path), "camera": one.camera, "lens": one.lens, "f_number": one.f_number,
            "focal_length_mm": one.focal_length_mm, "subject_distance_mm": one.subject_distance_mm,
            "not_compared": list(self.unknown),
        }  # fmt: skip


def library_folder() -> Path:
    """The folder of the library: as the environment says, or in the user's data."""
    data = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(os.environ.get(ENVIRONMENT) or Path(data) / "calibration-station" / "profiles")


def _missing(exposure: Exposure) -> list[str]:
    return [name.replace("_", "-") for name in KEY if not getattr(exposure, name)]


def add_profile(result: Path, given: Exposure, library: Path, *, replace: bool = False) -> Profile:
    """Copy the field of a result into the library; settings that are given take precedence over those in its file.
    Raises BadInput if there is no field; BadParameter if the key is incomplete, or the library has it."""
    source = field_path(result)
    recorded = read_camera(source) or Exposure()
    exposure = completed(given, recorded)
    if missing := _missing(exposure):
        raise BadParameter(
            f"a profile needs camera, lens and f-number; {source} does not record its {', '.join(missing)}",
            f"give {', '.join(f'--{name}' for name in missing)}",
        )
    focal, focus = exposure.focal_length_mm, exposure.subject_distance_mm
    words = [exposure.camera, exposure.lens, f"f{exposure.f_number:g}"]
    words += [f"{focal:g}mm"] if focal else []
    words += [f"{focus / 1000:g}m"] if focus else []
    path = library / ("_".join(re.sub(r"(?:[^\w.]|_)+", "-", str(word)).strip("-.") for word in words) + ".h5")
    if path.exists() and not replace:
        raise BadParameter(f"the library has a profile with these settings, {path}", "give --replace")
    library.mkdir(parents=True, exist_ok=True)

    def copy(beside: Path) -> None:
        shutil.copyfile(source, beside)
        set_camera(beside, exposure)

    with written(path, copy) as file:
        file.publish()
    return Profile(path, exposure)


def completed(given: Exposure, recorded: Exposure) -> Exposure:
    """The settings that identify a field: those given, else those recorded."""
    names = (*KEY, "focal_length_mm", "subject_distance_mm")
    return Exposure(**{name: getattr(given, name) or getattr(recorded, name) for name in names})


def profiles(library: Path) -> list[Profile]:
    """All fields of the library, by name. Raises BadInput if one is damaged."""
    return [Profile(path, read_camera(path) or Exposure()) for path in sorted(library.glob("*.h5"))]


def find_profiles(wanted: Exposure, library: Path) -> list[Profile]:
    """The fields for these settings, those first of which most is known, then those focused nearest. Raises BadInput if
    there is none; the reason is that of the most similar one."""
    fitting, reasons = [], []
    for one in profiles(library):
        try:
            fitting.append(Profile(one.path, one.exposure, tuple(check_exposure(wanted, one.exposure))))
        except Refused as refusal:
            like = sum(getattr(one.exposure, name) == getattr(wanted, name) for name in KEY)
            reasons.append((-like, one.path.name, refusal.reason))
    if fitting:
        return sorted(fitting, key=lambda one: (len(one.unknown), _magnification_off(wanted, one.exposure)))
    why = f"{min(reasons)[1]}: {min(reasons)[2]}" if reasons else "it is empty"
    raise BadInput(f"the library {library} has no field for these settings; {why}", "measure one, and add it")


def profile_for(exposure: Exposure) -> Path:
    """The field of the library for a photograph. Raises BadInput if there is none, BadParameter if the photograph does
    not record what identifies one."""
    if missing := _missing(exposure):
        raise BadParameter(
            f"a field is chosen by camera, lens and f-number; the photograph does not record its {', '.join(missing)}",
            "give --field",
        )
    return find_profiles(exposure, library_folder())[0].path


def _magnification_off(wanted: Exposure, other: Exposure) -> float:
    """Difference of the image scales by focus; 0 where it is unknown."""
    focal, ours, theirs = wanted.focal_length_mm, wanted.subject_distance_mm, other.subject_distance_mm
    return abs(focal / ours - focal / theirs) if focal and ours and theirs else 0.0
