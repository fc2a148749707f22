"""A disk that fails at a chosen operation: the power goes, the disk is full, or a write stops half way."""

import errno
import os
from collections.abc import Callable
from pathlib import Path

from station.common.durable_files import Disk


class PowerCut(BaseException):
    """Nothing after this happened."""


class FaultyDisk(Disk):
    """Counts writes, synchronisations and renames; the one numbered `at` is the last that begins.

    how: "before" (nothing of it happens), "after" (it happens, nobody hears), "half" (half the bytes are written),
    "full" (half the bytes, then no space is left, as long as `full` is set). `lose` takes away what was never
    synchronised, as a power cut may.
    """

    def __init__(self, at: int = -1, how: str = "before", real_sync: bool = False) -> None:
        self.at, self.how, self.count = at, how, 0
        self.full = False
        self._real_sync = real_sync
        self._paths: dict[int, Path] = {}
        self._unsynced: dict[Path, bytes | None] = {}
        self._renamed: list[tuple[Path, Path, bytes | None]] = []

    def open(self, path, flags, mode=0o666):
        made = flags & os.O_CREAT and path not in self._unsynced
        before = path.read_bytes() if made and path.is_file() else None
        descriptor = super().open(path, flags, mode)
        self._paths[descriptor] = path
        if made:
            self._unsynced[path] = before
        return descriptor

    def write(self, descriptor, data):
        path = self._paths[descriptor]
        if path not in self._unsynced:
            self._unsynced[path] = path.read_bytes()
        half = data[: len(data) // 2]
        return self._perform(
            lambda: super(FaultyDisk, self).write(descriptor, data), lambda: os.write(descriptor, half)
        )

    def sync(self, descriptor):
        path = self._paths[descriptor]

        def sync() -> None:
            if self._real_sync:
                os.fsync(descriptor)
            if path.is_dir():
                self._renamed = [entry for entry in self._renamed if entry[1].parent != path]
            self._unsynced.pop(path, None)

        self._perform(sync)

    def replace(self, source, target):
        self._rename(super().replace, source, target)

    def place(self, source, target):
        self._rename(super().place, source, target)

    def _rename(self, action, source, target):
        def rename() -> None:
            older = target.read_bytes() if target.is_file() else None
            action(source, target)
            self._renamed.append((source, target, older))
            if source in self._unsynced:
                self._unsynced[target] = self._unsynced.pop(source)

        self._perform(rename)

    def _perform(self, action: Callable[[], object], partly: Callable[[], object] = lambda: None):
        self.count += 1
        if self.full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if self.count != self.at:
            return action()
        if self.how in ("half", "full"):
            partly()
        if self.how == "full":
            self.full = True
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if self.how == "after":
            action()
        return self.cut()

    def cut(self) -> None:
        """The last that happens."""
        raise PowerCut

    def lose(self) -> None:
        """Take back every rename and every byte that was not synchronised."""
        for source, target, older in reversed(self._renamed):
            if target.exists():
                os.replace(target, source)
                if target in self._unsynced:
                    self._unsynced[source] = self._unsynced.pop(target)
                if older is not None:
                    target.write_bytes(older)
        for path, content in self._unsynced.items():
            if path.is_file():
                path.chmod(0o644)
                path.write_bytes(content or b"")
