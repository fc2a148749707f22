"""Photographs without a camera on the bench: the operator takes them, and the files arrive in a folder."""

import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

from drivers.errors import Clock, FrameMissing
from drivers.frames import sha256_of
from drivers.interfaces import CameraSettings, ExposedFile
from procedures.plan import Ask, Fact
from station.calibration.folder_photographs import photographs_in
from station.guide.coach import Ended
from station.guide.dialogue import Coach

FOLDER = Ask("frames_folder", "Folder in which your photographs arrive?", "text", default=".")


class HandCamera:
    """Asks for a photograph and takes the next new file of the folder."""

    def __init__(
        self, ask: Callable[[Ask], Fact], clock: Clock, meanwhile: Callable[[Coach], AbstractContextManager[None]]
    ) -> None:
        self._ask, self._clock, self._meanwhile = ask, clock, meanwhile
        self._missed = self._arrived = False
        self._arrive_in(FOLDER)

    def _arrive_in(self, ask: Ask) -> None:
        """Ask for the folder; files that are in it already are ignored. Raises BadInput where it does not exist."""
        self.folder = Path(str(self._ask(ask))).expanduser()
        self._known = photographs_in(self.folder)

    def _correct_folder(self) -> None:
        before, known = self.folder, self._known
        self._arrive_in(replace(FOLDER, default=str(before)))
        if self.folder == before:
            self._known = known  # a late file is the photograph

    def arrives(self, ended: Ended) -> bool:
        """Wait for the next photograph; False where `ended` comes first."""
        from station.guide.focus.live import PhotographSource  # imported here: its dependencies are slow to import

        source = PhotographSource(lambda: ended(True))
        return next(source.watched(self.folder, time.sleep), None) is not None

    def after_correction(self, ended: Ended) -> bool:
        """Wait for the photograph after a manual correction; those taken before it are ignored."""
        self._known |= photographs_in(self.folder)
        self._arrived = self.arrives(ended)
        return self._arrived

    def expose(self) -> ExposedFile:
        """The photograph that the operator takes now. Raises FrameMissing, BadInput."""
        if self._missed:
            self._correct_folder()
        requested_s = self._clock.now_s()
        if not self._arrived:
            with self._meanwhile(self.arrives):
                self._ask(Ask("photographed", f"Take one photograph, and wait until its file is in {self.folder}."))
        self._arrived = False
        new = sorted(photographs_in(self.folder) - self._known, key=lambda path: path.stat().st_mtime_ns)
        self._missed = not new
        if not new:
            raise FrameMissing(
                f"no new photograph in {self.folder}",
                "check the tethering software or name another folder, then take the photograph again",
            )
        path = new[0]  # further new files are the next photographs
        self._known.add(path)
        return ExposedFile(
            path, sha256_of(path), path.stat().st_size, CameraSettings(), requested_s, self._clock.now_s()
        )
