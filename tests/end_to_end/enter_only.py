"""An operator who presses Enter at every prompt, before either front end; each walk is bounded, so that none hangs."""

import asyncio
import io
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from procedures.outcome import Verdict
from simulators.bench.view import View
from station.app.app import StationApp
from station.app.commands import NewSession
from station.app.screens.guide import GuideScreen
from station.app.screens.parts import MIN_READ_S
from station.cli.guide import Watched
from station.guide.frontend import CONSENTS
from station.guide.workspace import StationLab
from station.sessions.reader import read_session
from tests.benchmarks import processor_s
from tests.station.app.driving import Driver

MAX_PROMPTS = 400
"""Prompts of one walk; the longest plan has about a hundred."""
MAX_REPEATS = 40
"""How often one question may be asked in one walk; a focus ring is turned by the same step 16 times."""
PATIENCE_S = 1800.0
"""Wall-clock limit of a walk in the application, on a loaded machine."""
FRONTENDS = ("plain", "app")


@dataclass(frozen=True)
class Walk:
    """How a walk ended.

    Attributes
    ----------
    folder : Path
        The session.
    ended : str or None
        How the run ended; "finished" where every step was done.
    verdict : str
        Of the last result; empty where there is none.
    prompts : int
        Questions answered.
    transcript : str
        What was shown and answered.
    processor_s : float
        Processor time of this process and its children.
    view : View
        What the bench's camera photographed.
    """

    folder: Path | None
    ended: str | None
    verdict: str
    prompts: int
    transcript: str
    processor_s: float
    view: View

    @property
    def passed(self) -> bool:
        """Whether every step was done and the result passed."""
        return self.ended == "finished" and self.verdict == Verdict.PASS

    @property
    def summary(self) -> str:
        """One line of figures."""
        return f"{self.verdict or self.ended}: {self.prompts} prompts, {self.processor_s:.1f} s of processor time"


class DeadEnd(Exception):
    """More prompts, or more of the same, than any plan needs."""


class Prompts:
    """Counts prompts. Raises DeadEnd where they do not end."""

    def __init__(self) -> None:
        self.asked: Counter[str] = Counter()

    def add(self, question: str) -> None:
        """One more."""
        self.asked[question] += 1
        if self.asked.total() > MAX_PROMPTS or self.asked[question] > MAX_REPEATS:
            raise DeadEnd(f"asked {self.asked[question]} times, of {self.asked.total()} prompts: {question}")


class EnterKey(io.StringIO):
    """A stdin on which every line is empty; it ends where the prompts do not."""

    def __init__(self, shown: io.StringIO) -> None:
        super().__init__()
        self.prompts = Prompts()
        self._shown = shown

    def readline(self, size: int = -1, /) -> str:
        """An empty line, in answer to the last line shown."""
        try:
            self.prompts.add(self._shown.getvalue().rpartition("\n")[2])
        except DeadEnd as error:
            self._shown.write(f"\n(dead end: {error})")
            return ""
        return "\n"


def lab_for(folder: Path, seed: int) -> StationLab:
    """The simulated bench as `--simulate --seed` opens it, in virtual time."""
    lab = StationLab(sessions=folder / "sessions", config=None, simulate=True, seed=seed)
    lab.virtual_time = True
    return lab


def walk(plan: str, seed: int, frontend: str, folder: Path) -> Walk:
    """Walk a plan from its first prompt to its last by Enter alone."""
    began_s, lab = processor_s(), lab_for(folder, seed)
    try:
        prompts, transcript = {"plain": walk_plain, "app": walk_app}[frontend](lab, plan)
        view = lab.open().bench.simulated.view
    finally:
        lab.close()
    kept = [(one.folder, read_session(one.folder).state) for one in lab.kept()]
    session, state = kept[0] if kept else (None, None)
    verdict = state.results[-1].verdict if state is not None and state.results else ""
    ended = None if state is None else state.ended
    return Walk(session, ended, verdict, prompts.asked.total(), transcript, processor_s() - began_s, view)


def walk_plain(lab: StationLab, plan: str) -> tuple[Prompts, str]:
    """Through the lines that `station --plain` writes and reads."""
    shown = io.StringIO()
    enter = EnterKey(shown)
    lab.begin(plan, *lab.names, Watched(enter, shown)).go()
    return enter.prompts, shown.getvalue()


def walk_app(lab: StationLab, plan: str) -> tuple[Prompts, str]:
    """Through the application's screens and keys."""
    return asyncio.run(_press_enter_until_rest(StationApp(lab, plan=plan)))


async def _press_enter_until_rest(app: StationApp) -> tuple[Prompts, str]:
    prompts, pages, asked = Prompts(), [], None
    async with app.run_test(size=(100, 30)) as pilot:
        driver, end = Driver(app, pilot), time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            await pilot.pause(0.05)
            guide = next((one for one in app.screen_stack if isinstance(one, GuideScreen)), None)
            if guide is not None and guide.can(NewSession) and app.running("run") is None:
                break
            if guide is not None and guide.answers.open and (ask := guide.answers._ask) is not asked:
                asked = ask
                pages.append(driver.text)
                try:
                    prompts.add(guide.answers.question)
                except DeadEnd as error:
                    pages.append(f"(dead end: {error})")
                    break
            if guide is None or guide.answers.open:
                await pilot.press("enter")
                if asked is not None and asked.key in CONSENTS:  # keys in quick succession never consent
                    await pilot.pause(1.25 * MIN_READ_S)
        pages.append(driver.text)
    return prompts, f"\n{'-' * 100}\n".join(pages)
