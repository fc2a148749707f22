"""Build hook of hatch: compile the loops' C++ where that is possible. In a checkout, run this file."""

import contextlib
import sys
import sysconfig
import textwrap
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FOLDER = Path(__file__).resolve().parent
ROOT = FOLDER.parents[2]
MODULE = FOLDER / f"_native{sysconfig.get_config_var('EXT_SUFFIX')}"
# sums may be reordered, so that loops over them use vector registers; NaN and infinity keep their meaning
FLAGS = [
    "-O2", "-ftree-vectorize", "-fno-math-errno", "-fno-trapping-math", "-fassociative-math", "-fno-signed-zeros",
    "-freciprocal-math",
]  # fmt: skip


def build() -> None:
    """Compile the extension next to its source, unless it is up to date."""
    newest = max(path.stat().st_mtime for path in FOLDER.iterdir() if path.suffix in (".h", ".cpp"))
    if MODULE.exists() and MODULE.stat().st_mtime >= newest:
        return
    MODULE.unlink(missing_ok=True)
    from pybind11.setup_helpers import Pybind11Extension
    from setuptools import Distribution

    name = ".".join([*FOLDER.relative_to(ROOT).parts, "_native"])
    flags = ["/O2"] if sys.platform == "win32" else FLAGS
    extension = Pybind11Extension(name, [str(FOLDER / "module.cpp")], extra_compile_args=flags, cxx_std=17)
    command: Any = Distribution({"name": "native", "ext_modules": [extension]}).get_command_obj("build_ext")
    with TemporaryDirectory() as objects, contextlib.redirect_stdout(sys.stderr):
        command.build_lib, command.build_temp, command.force = str(ROOT), objects, True
        command.ensure_finalized()
        command.run()


class LoopExtension(BuildHookInterface[Any]):
    """Adds the extension to a wheel, which is then one for this system and Python; without a compiler, adds nothing."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile before the files are gathered."""
        try:
            build()
        except BaseException as error:  # setuptools ends the program when there is no compiler
            if isinstance(error, KeyboardInterrupt):
                raise
            reason = textwrap.shorten(f"{type(error).__name__} {error}", 120)
            self.app.display_warning(f"no extension, its loops run slower by array operations: {reason}")
        else:
            build_data["artifacts"].append(MODULE.relative_to(ROOT).as_posix())
            build_data.update(pure_python=False, infer_tag=True)


if __name__ == "__main__":
    build()
