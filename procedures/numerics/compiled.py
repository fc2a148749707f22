"""Loops as machine code: two decorators, so that every kernel is built and kept in the same way.

Numba compiles; it is imported when there is something to compile. What was compiled before is loaded without it, see
`kernel_store`.
"""

from __future__ import annotations

import hashlib
import threading
import types
from collections.abc import Callable, Iterator
from functools import cached_property, lru_cache, update_wrapper
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeVar

import numpy as np

from procedures.numerics.kernel_cache import tell_not_kept
from procedures.numerics.native_call import described, shape_of

P = ParamSpec("P")
R = TypeVar("R")
_BUILDING = threading.RLock()


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """The function as machine code that runs outside Python's lock, kept on disk between runs where that is possible.

    Division by zero gives infinity or NaN as in NumPy. Kernels start no threads: those are the caller's.
    """
    return Kernel(function, fastmath=False)


def vectorised(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, for data without NaN: sums may be reordered, so that loops over them fill vector registers."""
    return Kernel(function, fastmath={"reassoc", "contract", "nsz", "arcp", "nnan"})


@lru_cache
def _digest(source: Path, *_changed: int) -> str:
    """Of a source file, found again when its time or size has changed; copies of one file share what is compiled."""
    return hashlib.sha256(source.read_bytes()).hexdigest()


class Kernel(Generic[P, R]):
    """A function that is compiled for each kind of arguments when they first come. Kernels may call kernels."""

    def __init__(self, function: Callable[P, R], **options: Any) -> None:
        update_wrapper(self, function)
        self._function: Any = function
        self._options = {"nogil": True, "error_model": "numpy", **options}
        self._ready: dict[str, Callable[..., Any]] = {}

    def __call__(self, *arguments: P.args, **named: P.kwargs) -> R:
        """The function's answer."""
        kind = "" if named else described(arguments)
        ready = self._ready.get(kind) or self._prepared(kind, arguments)
        answer: R = ready(*arguments, **named)
        return answer

    def _prepared(self, kind: str, arguments: tuple[Any, ...]) -> Callable[..., Any]:
        with _BUILDING:
            if kind not in self._ready:
                self._ready[kind] = self._from_store(kind, arguments) if kind else self._by_numba()
            return self._ready[kind]

    def _from_store(self, kind: str, arguments: tuple[Any, ...]) -> Callable[..., Any]:
        """The code that was kept or is compiled now; Numba's own function where it cannot be kept."""
        try:
            from procedures.numerics import kernel_lock
            from procedures.numerics import kernel_store as store  # it loads LLVM

            source = Path(self._function.__code__.co_filename)
            content = "\n".join([store.environment(), *self._content()])
            path = store.file_of(source, f"{source.stem}.{self._function.__qualname__}", kind, content)
        except (OSError, ImportError) as error:  # no source file, or no place for what is made of it
            tell_not_kept(error)
            return self._by_numba()
        code = store.read(path)
        if code is None:
            with kernel_lock.only_one(path):
                code = store.read(path)  # another process may have compiled it meanwhile
                if code is None:
                    try:
                        code = self._compiled(arguments)
                    except (store.NotStorable, TypeError):
                        return self._by_numba()
                    store.keep(path, code)
        return store.loaded(code)

    def _by_numba(self) -> Callable[..., Any]:
        function: Callable[..., Any] = self.dispatcher
        return function

    def _compiled(self, arguments: tuple[Any, ...]) -> Any:
        from numba import typeof

        from procedures.numerics.kernel_store import extracted

        signature = tuple(typeof(one) for one in arguments)  # type: ignore[no-untyped-call]
        self.dispatcher.compile(signature)
        found = self.dispatcher.overloads[signature]
        return extracted(found.library, found.fndesc.llvm_func_name, shape_of(found.signature.return_type))

    @cached_property
    def dispatcher(self) -> Any:
        """Numba's own function, which compiles what it is called with."""
        import numba  # it takes longer than most of what the kernels do

        function = self._function
        called = {name: kernel.dispatcher for name, kernel in self._called().items()}
        known = {**function.__globals__, **called}
        copy = types.FunctionType(
            function.__code__, known, function.__name__, function.__defaults__, function.__closure__
        )
        copy.__module__, copy.__qualname__ = function.__module__, function.__qualname__
        return numba.njit(**self._options)(copy)

    def _content(self) -> Iterator[str]:
        """All that the code depends on: source files, constants, and the same of the kernels that are called."""
        code = self._function.__code__
        source = Path(code.co_filename)
        status = source.stat()
        yield f"{code.co_name} {code.co_firstlineno} {_digest(source, status.st_mtime_ns, status.st_size)}"
        yield " ".join(f"{name} {value}" for name, value in sorted(self._options.items()) if name != "fastmath")
        yield f"fastmath {sorted(self._options['fastmath'] or ())}"
        for name in code.co_names:
            value = self._function.__globals__.get(name)
            if isinstance(value, bool | int | float | complex | tuple | np.generic):
                yield f"{name} {value!r}"
            elif isinstance(value, np.ndarray):
                yield f"{name} {value.dtype} {value.shape} {value.tobytes().hex()}"
        for kernel in self._called().values():
            yield from kernel._content()

    def _called(self) -> dict[str, Kernel[..., Any]]:
        """The kernels that this one calls, by their global names."""
        known = ((name, self._function.__globals__.get(name)) for name in self._function.__code__.co_names)
        return {name: value for name, value in known if isinstance(value, Kernel) and value is not self}
