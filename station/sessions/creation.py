"""Creation of a session's folder: filled under a hidden name, then renamed, so that it appears atomically."""

from __future__ import annotations

from pathlib import Path

from station.common.durable_files import Disk, WriteFailed, write_errors
from station.sessions.journal import Contents, Journal, JournalLine
from station.sessions.layout import CONFIG, FOLDERS, JOURNAL, read_config


def furnish(folder: Path, config: bytes, first: JournalLine, disk: Disk) -> None:
    """Write everything that a session needs, durably."""
    for name in FOLDERS:
        with write_errors(folder / name):
            (folder / name).mkdir()
    for name, data in ((CONFIG, config), (JOURNAL, b"")):
        disk.write_whole(folder / name, data)
    _, first_sum = read_config(folder)
    journal = Journal(folder / JOURNAL, Contents((), first_sum, 0), disk)
    try:
        journal.append(first.event, first.at, first.clock_s, first.data)
    finally:
        journal.close()


def settle(raw: Path, name: str, disk: Disk) -> Path:
    """Rename the folder to its name, with a number if that is taken."""
    for number in range(1, 10_000):
        folder = raw.with_name(name if number == 1 else f"{name}-{number}")
        if not folder.exists() and not folder.is_symlink():
            with write_errors(folder):
                disk.replace(raw, folder)
                disk.sync_folder(folder.parent)
            return folder
    raise WriteFailed(f"{raw.parent} has 9999 sessions of the name {name}", "name another folder with --sessions")
