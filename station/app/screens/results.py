"""The results: PSF image, MTF curves with uncertainty bands, verdicts and numbers; comparison of two."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from textual import on
from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll

from procedures.outcome import ProcedureError
from station.app.background import BackgroundJob
from station.app.commands import RESULTS, Command, Compare, NextPlane, Reload, bindings
from station.app.screens.parts import Choices, StationScreen
from station.app.screens.result_view import changes_in_words, mtf_plot, plane_in_words, restored_in_words
from station.app.terminal_images import picture_thumbnail, psf_thumbnail
from station.app.widgets import CurveView, Part, Picture, lines_of
from station.drawing.glyphs import Glyphs
from station.results.measurement import RESTORATION, Measurement
from station.results.plane_result import PlaneResult
from station.results.reader import changes, find_results, read_picture, read_result

EMPTY = "-empty"
NONE_YET = "There is no result yet: start a measurement with the guide (F2)."


@dataclass(frozen=True)
class ResultEntry:
    """A result folder with its contents, or why it cannot be shown."""

    folder: Path
    result: Measurement | None = None
    wrong: str = ""

    def name(self) -> str:
        return f"{self.folder.parent.parent.name}  {self.folder.name}"


def read_all(sessions: Path) -> list[ResultEntry]:
    """Every result under a folder of sessions, newest first."""
    entries = []
    for folder in find_results(sessions):
        try:
            entries.append(ResultEntry(folder, read_result(folder)))
        except ProcedureError as error:
            entries.append(ResultEntry(folder, wrong=str(error)))
        except Exception as error:  # a damaged result must not hide the others
            entries.append(ResultEntry(folder, wrong=f"{folder} cannot be shown: {error!r}"))
    return entries


class ResultsScreen(StationScreen):
    """The list of results and the chosen one."""

    COMMANDS_HERE = RESULTS
    BINDINGS: ClassVar[list[BindingType]] = bindings(RESULTS)

    def __init__(self, sessions: Path) -> None:
        super().__init__()
        self._sessions = sessions
        self._entries: Sequence[ResultEntry] = ()
        self._chosen: ResultEntry | None = None
        self._compared: ResultEntry | None = None
        self._plane = ""

    def body(self) -> ComposeResult:
        with Horizontal(id="middle"):
            with VerticalScroll(id="list", can_focus=False):
                yield Choices(id="entries")
            with Vertical(id="shown"):
                with Horizontal(id="pictures"):
                    yield Picture(id="psf")
                    yield CurveView(id="mtf")
                with VerticalScroll(id="numbers", can_focus=False):
                    yield Part(NONE_YET, id="words")

    def on_mount(self) -> None:
        super().on_mount()
        self.set_class(True, EMPTY)
        self.query_one(Choices).focus()

    def on_screen_resume(self) -> None:
        super().on_screen_resume()
        self.look_again()

    @on(Reload)
    def look_again(self) -> None:
        """Read the folders in a thread."""
        BackgroundJob("results", lambda: read_all(self._sessions), self.app.report_finished).start()  # type: ignore[attr-defined]

    def show_entries(self, entries: Sequence[ResultEntry]) -> None:
        """Show the results; the chosen one stays chosen."""
        self._entries = entries
        self.set_class(not entries, EMPTY)
        at = next((i for i, entry in enumerate(entries) if self._chosen and entry.folder == self._chosen.folder), 0)
        self.query_one(Choices).set_lines([self._line(entry) for entry in entries], at)
        if entries:
            self._choose(entries[at])

    def _line(self, entry: ResultEntry) -> str:
        kept = " (kept to compare)" if self._compared and entry.folder == self._compared.folder else ""
        return entry.name() + kept

    @on(Choices.Moved)
    @on(Choices.Chosen)
    def _chosen_in_list(self, event: Choices.Moved | Choices.Chosen) -> None:
        event.stop()
        self._choose(self._entries[event.index])

    def _choose(self, entry: ResultEntry) -> None:
        self._chosen = entry
        self._show()

    @on(NextPlane)
    def next_plane(self) -> None:
        result = self._chosen.result if self._chosen else None
        names = list(result.by_name) if result else []
        if names:
            self._plane = names[(names.index(self._shown_plane(names)) + 1) % len(names)]
            self._show()

    @on(Compare)
    def compare(self) -> None:
        self._compared = None if self._compared is not None else self._chosen
        self.show_entries(self._entries)

    def can(self, command: type[Command]) -> bool:
        return command is Reload or self._chosen is not None

    def _shown_plane(self, names: Sequence[str]) -> str:
        return self._plane if self._plane in names else "G1" if "G1" in names else names[0]

    def _plane_of(self, entry: ResultEntry | None) -> PlaneResult | None:
        if entry is None or entry.result is None or not entry.result.planes:
            return None
        return entry.result.by_name[self._shown_plane(list(entry.result.by_name))]

    def _show(self) -> None:
        one, other = self._plane_of(self._chosen), self._plane_of(self._compared)
        result = self._chosen.result if self._chosen else None
        if self._chosen is not None and result is not None and result.schema == RESTORATION:
            self._show_restoration(self._chosen.folder, result)
            return
        if self._chosen is not None and one is None:
            self.query_one("#words", Part).update(lines_of(self._chosen.wrong or "the result has no planes"))
        if one is None:
            self._draw(None, ())
        elif other is None or self._compared == self._chosen:
            self._draw(one, (one,))
            self.query_one("#words", Part).update(lines_of(*plane_in_words(one, self._glyphs)))
        else:
            self._draw(one, (other, one))
            lines = changes_in_words(changes(other, one), self._glyphs)
            head = f"Plane {one.name}: kept (solid) | chosen (dashed)"
            self.query_one("#words", Part).update(lines_of(head, *(lines or ["the results have no number in common"])))

    def _show_restoration(self, folder: Path, restoration: Measurement) -> None:
        self._draw(None, ())
        lines = restored_in_words(restoration, self._glyphs)
        try:
            if not restoration.refused:
                self.query_one(Picture).show(picture_thumbnail(read_picture(folder / "sharp.png"), "restored image"))
        except ProcedureError as error:
            lines.append(str(error))
        self.query_one("#words", Part).update(lines_of(*lines))

    def _draw(self, result: PlaneResult | None, curves: Sequence[PlaneResult]) -> None:
        h = None if result is None else result.samples
        picture = None if result is None or h is None else psf_thumbnail(h, f"PSF of plane {result.name}")
        self.query_one(Picture).show(picture)
        self.query_one(CurveView).show(mtf_plot(curves))

    @property
    def _glyphs(self) -> Glyphs:
        return self.query_one(Picture).glyphs
