"""All rows in the order of the papers, and the parts of the papers that cannot be computed here: `rows.toml`."""

import hashlib
import tomllib
import urllib.error
import urllib.request
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path

from procedures.outcome import BadInput
from procedures.ray_histogram.film import Film
from procedures.ray_histogram.film_files import write_film
from simulators.rays.path_tracer import cast
from simulators.rays.ray_scenes import SCENES
from station.common.durable_files import write_whole
from station.common.progress import Progress, silent
from station.demo.reproduce.row import Row, read_row

TIMEOUT_S = 60
MAX_BYTES = 32_000_000
FILM_SIDE = 128
FILMS = {"rays/room_00064.npz": 64, "rays/room_00256.npz": 256}
REFERENCE, REFERENCE_SAMPLES = "rays/room_reference.npz", 2048


@dataclass(frozen=True)
class PublishedFile:
    """A file of a public repository: its path in the data folder, its address at one commit, and its SHA-256."""

    path: str
    url: str
    sha256: str
    licence: str

    def is_in(self, folder: Path) -> bool:
        """Whether the folder has the file with these contents."""
        place = folder / self.path
        return place.is_file() and hashlib.sha256(place.read_bytes()).hexdigest() == self.sha256

    def download(self, folder: Path) -> None:
        """Write the file. Raises BadInput if it cannot be obtained or has other contents."""
        try:
            with urllib.request.urlopen(self.url, timeout=TIMEOUT_S) as answer:  # addresses of rows.toml
                data = answer.read(MAX_BYTES)
        except (urllib.error.URLError, OSError) as error:
            raise BadInput(
                f"{self.url} must be reachable; {error}",
                f"connect to the network, or put the file at {folder / self.path}",
            ) from error
        digest = hashlib.sha256(data).hexdigest()
        if digest != self.sha256:
            raise BadInput(
                f"{self.url} must have the SHA-256 {self.sha256}; got {digest}",
                f"obtain the file of that commit elsewhere, and put it at {folder / self.path}",
            )
        write_whole(folder / self.path, data)


def fetch(folder: Path, files: Sequence[PublishedFile], *, threads: int = 1, progress: Progress = silent) -> None:
    """Complete a data folder: download missing photographs, and render missing films. Raises BadInput if a photograph
    cannot be obtained, or has other contents than the published ones."""
    work: list[tuple[str, Callable[[Path], None]]] = [
        *((file.path, file.download) for file in files if not file.is_in(folder)),
        *(
            (name, partial(_render, name=name, samples=samples, threads=threads))
            for name, samples in {**FILMS, REFERENCE: REFERENCE_SAMPLES}.items()
            if not (folder / name).exists()
        ),
    ]
    for path, obtain in work:
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        obtain(folder)
        progress(f"wrote {folder / path}")


def _render(folder: Path, *, name: str, samples: int, threads: int) -> None:
    film = Film.blank(FILM_SIDE, FILM_SIDE)
    cast(*SCENES["room"](FILM_SIDE, FILM_SIDE), samples, film.add, seed=samples, threads=threads)
    write_film(film, folder / name)


_TABLES = tomllib.loads(files(__package__).joinpath("rows.toml").read_text("utf-8"))
ROWS: tuple[Row, ...] = tuple(read_row(name, table) for name, table in _TABLES["rows"].items())
NOT_HERE: tuple[tuple[str, str], ...] = tuple((one["place"], one["reason"]) for one in _TABLES["not_here"])
"""(place, reason)."""
PUBLISHED_FILES = tuple(PublishedFile(**one) for one in _TABLES["files"])
