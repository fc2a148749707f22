"""The PSF of each plane from two photographs of a wall at different distances."""

from collections.abc import Sequence
from pathlib import Path

from procedures.two_photo.estimate import TwoPhotoParameters
from station.calibration.planes import calibrate_wall
from station.common.progress import Progress, silent
from station.procedure.base import Inputs
from station.procedure.psf import PsfProcedure, PsfSettings
from station.results.measurement import Measurement
from station.results.terms import USUAL, Terms


class TwoPhotoSettings(PsfSettings, frozen=True, kw_only=True):
    """Sampling, solver and optics."""

    def check(self) -> None:
        """Raise BadParameter if the sampling is impossible."""
        super().check()
        TwoPhotoParameters(**self.sampling())


class TwoPhoto(PsfProcedure[TwoPhotoSettings]):
    """Two or more photographs of one textured wall."""

    name = "two-photo"
    title = "PSF from two photographs of a wall"
    help = """Estimate the PSF from A and B, photographs of one textured wall at distances more than s times apart.

    More photographs, each more than s times as far as the nearest, lower the uncertainty."""
    inputs = Inputs.SCENE
    argument = "A B..."
    Settings = TwoPhotoSettings
    endings = {"near": "_near", "far": "_far"}  # noqa: RUF012  (a constant of the class)

    def measure(
        self, paths: Sequence[Path], settings: TwoPhotoSettings, terms: Terms = USUAL, progress: Progress = silent
    ) -> Measurement:
        frames = []
        for path in paths:
            frames.append(settings.read(path))
            progress(f"read {path}")
        first = frames[0]
        parameters = TwoPhotoParameters(**settings.sampling(), at=terms.frequencies(settings.plane_pixels(first)))
        results = calibrate_wall(frames, parameters, settings.limit(first.exposure))
        return self.measurement(frames, results, parameters.to_record(), settings, terms)
