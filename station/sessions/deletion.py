"""Deletion of a session's folder: renamed first, so that a half-deleted folder is no longer a session."""

from __future__ import annotations

import secrets
import shutil
from pathlib import Path

from station.common.durable_files import write_errors
from station.sessions.layout import Lock, check_layout


def delete_session(folder: Path) -> None:
    """Delete a session with its photographs and results.

    Raises BadInput if the folder is not a session; Busy if a program has it open; NotKept if the disk refuses.
    """
    check_layout(folder)
    Lock(folder).release()  # raises if another program has it open
    doomed = folder.with_name(f".deleting-{secrets.token_hex(8)}")
    with write_errors(folder):
        folder.rename(doomed)
        shutil.rmtree(doomed)
