"""Machine code kept between runs, so that kernels start without the compiler.

A kernel is compiled by Numba once for each kind of arguments; its code is kept as an object file with its name and
the shape of its answer. Later runs load that with LLVM's linker (llvmlite), which takes a tenth of Numba's import.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import json
import os
import re
import tempfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite
import llvmlite.binding as llvm

from procedures.numerics.kernel_cache import tell_not_kept
from procedures.numerics.native_call import RETURNED_NONE, Shape, flattened, layout, taken, types_of

SUFFIX = ".kernel"
HIDDEN = ("define linkonce_odr ", "define internal ")
"""What the functions that a kernel calls are told as, and are made: others may bring their own of the same name."""
RUN_TIME = """
define internal ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align) {
  %wide = zext i32 %align to i64
  %head = add i64 %wide, 48
  %all = add i64 %size, %head
  %block = call ptr @malloc(i64 %all)
  %none = icmp eq ptr %block, null
  br i1 %none, label %out, label %fill
fill:
  %address = ptrtoint ptr %block to i64
  %last = add i64 %head, -1
  %beyond = add i64 %address, %last
  %mask = sub i64 0, %wide
  %aligned = and i64 %beyond, %mask
  %data = inttoptr i64 %aligned to ptr
  store i64 1, ptr %block
  %at1 = getelementptr i8, ptr %block, i64 8
  store ptr null, ptr %at1
  %at2 = getelementptr i8, ptr %block, i64 16
  store ptr null, ptr %at2
  %at3 = getelementptr i8, ptr %block, i64 24
  store ptr %data, ptr %at3
  %at4 = getelementptr i8, ptr %block, i64 32
  store i64 %size, ptr %at4
  %at5 = getelementptr i8, ptr %block, i64 40
  store ptr null, ptr %at5
  br label %out
out:
  ret ptr %block
}
define internal void @NRT_MemInfo_call_dtor(ptr %block) {
  call void @free(ptr %block)
  ret void
}
declare ptr @malloc(i64)
declare void @free(ptr)
"""
"""What kernels need of Numba's run-time: blocks whose head counts their owners and points to their data (struct
MemInfo in numba/core/runtime/nrt.cpp), here from the C library's memory."""
_OURS = ("NRT_MemInfo_alloc_aligned", "NRT_MemInfo_call_dtor", "malloc", "free")


class NotStorable(Exception):
    """This code needs more of Numba than the store has."""


class Code(NamedTuple):
    """An object file, the name of the function in it, and the shape of its answer."""

    name: str
    answer: Shape
    binary: bytes


def extracted(library: Any, name: str, answer: Shape) -> Code:
    """The code of one compiled function, without the wrappers by which Python calls it. Raises NotStorable."""
    text = library.get_llvm_str()
    # the wrappers are the only definitions of these names, from their first line to the brace that stands alone
    text = re.sub(
        r"^define [^\n]*@(_ZN7cpython|\"?cfunc\.)[^\n]*\{\n.*?^\}\n", "", text, flags=re.MULTILINE | re.DOTALL
    )
    for ours in _OURS:
        text = re.sub(rf"^declare [^\n]*@{ours}\([^\n]*\n", "", text, flags=re.MULTILINE)
    text = text.replace("= common local_unnamed_addr global ptr null", "= internal global ptr null")
    text = text.replace(*HIDDEN)
    try:
        module = llvm.parse_assembly(text + RUN_TIME)
        module.verify()
    except RuntimeError as error:
        raise NotStorable(str(error)) from error
    _check_needed(text)
    return Code(name, answer, machine().emit_object(module))


def _check_needed(text: str) -> None:
    """Raise NotStorable unless all that the code calls from outside is in this process, Numba's own library apart."""
    process = ctypes.CDLL(None)
    outside = re.findall(r"^declare [^\n]*@\"?([\w.$]+)\"?\(", text, flags=re.MULTILINE)
    outside += re.findall(r"^@\"?([\w.$]+)\"? = external", text, flags=re.MULTILINE)
    for name in outside:
        called = len(re.findall(rf"@\"?{re.escape(name)}\"?(?![\w.$])", text)) > 1
        if called and not name.startswith("llvm.") and not hasattr(process, name):
            raise NotStorable(f"it calls {name}")


def machine() -> Any:
    """LLVM's machine for this processor with all that it can do; an engine takes the one that it is given for good."""
    return _target().create_target_machine(cpu=_processor()[0], features=_processor()[1], opt=3, jit=True)


@functools.cache
def _target() -> Any:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_default_triple()


@functools.cache
def _processor() -> tuple[str, str]:
    """Name and features."""
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


@functools.cache
def environment() -> str:
    """What machine code depends on beside its source."""
    numba = find_spec("numba")  # its metadata would take longer to read than the code to load
    if numba is None or numba.origin is None:
        raise ImportError("kernels are compiled by numba, which is not installed")
    version = Path(numba.origin).with_name("_version.py").read_text()
    return f"{llvmlite.__version__} {version} {_processor()} {RUN_TIME} {HIDDEN}"


def loaded(code: Code) -> Callable[..., Any]:
    """The function, for Python. It raises ArithmeticError where the machine code reports an error."""
    engine = _engine_without(code.name)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code.binary))
    engine.finalize_object()
    address = engine.get_function_address(code.name)
    kind, free = layout(code.answer), _free()
    native: Any = None

    def call(*arguments: Any) -> Any:
        nonlocal native
        numbers: list[Any] = []
        flattened(arguments, numbers)
        if native is None:  # all calls have arguments of one kind
            types = types_of(arguments)
            native = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p, *types)(address)
        answer, exception = kind(), ctypes.c_void_p()
        status = native(ctypes.addressof(answer), ctypes.addressof(exception), *numbers)
        if status not in (0, RETURNED_NONE):
            raise ArithmeticError(f"machine code of {code.name} ended with {status}")
        return taken(code.answer, answer, free)

    return call


_engines: list[tuple[Any, set[str]]] = []


def _engine_without(name: str) -> Any:
    """LLVM's linker: one for all functions, as making it takes longer than the linking, but for names that repeat."""
    for engine, names in _engines:
        if name not in names:
            names.add(name)
            return engine
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine())
    _engines.append((engine, {name}))
    return engine


@functools.cache
def _free() -> Callable[[int], object]:
    free = ctypes.CDLL(None).free
    free.argtypes, free.restype = [ctypes.c_void_p], None
    return lambda block: free(block)


# --- files -------------------------------------------------------------------------------------------------------


def place_of(source: Path) -> Path:
    """The folder for the code of a source file: where Numba's goes, beside it or in the user's cache."""
    told = os.environ.get("NUMBA_CACHE_DIR")
    beside = source.parent / "__pycache__"
    if told:
        return Path(told)
    if os.access(beside if beside.exists() else source.parent, os.W_OK):
        return beside
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "calibration-station"
    except RuntimeError as error:  # a user without a home
        raise OSError(str(error)) from error


def file_of(source: Path, stem: str, kind: str, content: str) -> Path:
    """The file of one kernel for one kind of arguments; `content` is all that its code depends on."""
    kinds, contents = (hashlib.sha256(text.encode()).hexdigest()[:12] for text in (kind, content))
    return place_of(source) / f"{stem}-{kinds}-{contents}{SUFFIX}"


def read(path: Path) -> Code | None:
    """What was kept; None where nothing was."""
    try:
        head, _, binary = path.read_bytes().partition(b"\n")
        known = json.loads(head)
        whole = hashlib.sha256(binary).hexdigest() == known["sha256"]
        return Code(known["name"], known["answer"], binary) if whole else None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def keep(path: Path, code: Code) -> None:
    """Write the code, in place of what was kept of older sources; where nothing can be written it is not kept."""
    head = {"name": code.name, "answer": code.answer, "sha256": hashlib.sha256(code.binary).hexdigest()}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        older = list(path.parent.glob(f"{path.name.rsplit('-', 1)[0]}-*{SUFFIX}"))
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            file.write(json.dumps(head).encode() + b"\n" + code.binary)
        os.replace(file.name, path)
        for one in older:
            if one != path:
                one.unlink(missing_ok=True)
    except OSError as error:
        tell_not_kept(error)
