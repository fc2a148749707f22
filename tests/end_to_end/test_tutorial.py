"""The tutorial is typed into a shell line by line, in an empty folder of a machine without a camera."""

import re
import sys

import pytest

from station.manual.pages import find_page, read_pages
from tests.station.app.test_terminal import Terminal

BLOCK = re.compile(r"^```sh(?: run)?(?: exit (?P<code>\d+))?\n(?P<lines>.*?)^```", re.MULTILINE | re.DOTALL)
PROMPT = "READY> "


@pytest.mark.nightly
def test_every_line_of_the_tutorial_does_what_it_says(tmp_path):
    programs, folder = tmp_path / "bin", tmp_path / "empty"
    programs.mkdir()
    folder.mkdir()
    (programs / "station").write_text(f'#!/bin/sh\nexec "{sys.executable}" -m station "$@"\n')
    (programs / "station").chmod(0o755)
    shell = Terminal(folder, ["bash", "--norc", "--noprofile"], PS1=PROMPT, PATH=f"{programs}:/usr/bin:/bin")
    try:
        shell.wait_for(PROMPT)
        for block in BLOCK.finditer(find_page(read_pages(), "without-a-camera").text):
            for line in block["lines"].splitlines():
                shell.press(f"{line}\n".encode())
                if line == "station --simulate":
                    shell.wait_for("press Enter to begin")
                    shell.press(b"\x11")
                shell.wait_for(PROMPT)
                shell.press(b"echo code $?.\n")
                shell.wait_for(f"code {block['code'] or 0}.")
                shell.wait_for(PROMPT)
    finally:
        shell.program.kill()
        shell.program.wait()
        shell.hang_up()
    for name in ("demo/index.html", "demo/chart.pdf", "result/result.json", "result/psf_G1.npy", "result/mtf_G1.csv"):
        assert (folder / name).is_file(), name
    assert (folder / "result" / "report.html").is_file()
    assert (folder / "wrong" / "result.json").is_file()
