"""Runs a plan: asks, moves, settles, exposes, checks. The only code that measures through drivers.

Whatever comes from the camera is in the session before anyone looks at it. Whatever a device or the disk refuses
becomes a sentence and a question: try again, skip, or stop.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, replace
from functools import singledispatchmethod
from pathlib import Path
from typing import TYPE_CHECKING

from drivers.clock import SystemClock
from procedures.outcome import ProcedureError, Refused
from procedures.plan import (
    Advice,
    Ask,
    Decide,
    Estimate,
    Give,
    Go,
    Home,
    Known,
    Look,
    Measure,
    Plan,
    Request,
    Scan,
    SetLight,
    Shoot,
    Show,
    Step,
    Tour,
)
from station.bench.surroundings import Surroundings
from station.common.atomic_files import write_whole
from station.guide.active_devices import AT, DISTANCE, LIGHT_LEVEL, Rig
from station.guide.consent import Consent
from station.guide.dialogue import Conversation, Skipped
from station.guide.exposure import Exposer, Photographer
from station.guide.frontend import (
    Doing,
    Operator,
    Result,
    RunBegan,
    RunEnded,
    Shown,
    StepBegan,
    StepEnded,
    Stopped,
    Trouble,
)
from station.guide.manual_camera import HandCamera
from station.guide.photographing import Watching
from station.guide.session_result import SessionResult, derive
from station.guide.vibration import Patience
from station.sessions.session import Session

if TYPE_CHECKING:
    from station.bench.opening import Bench

PAGE = "report.html"
ACCEPT, RETAKE = "accept", "retake"


class Reopened(Exception):
    """The operator goes back to an earlier step."""


class Run:
    """A plan on a bench (or on none), with a session as memory and an operator before it."""

    def __init__(
        self, plan: Plan, bench: Bench | None, session: Session, operator: Operator, patience: Patience | None = None
    ) -> None:
        self.plan = plan
        self._session = session
        self._patience = patience
        self._rig = Rig(bench)
        self._clock = bench.clock if bench else SystemClock()
        around = bench.surroundings if bench else Surroundings()
        around.stand_before(plan.subject)
        self._talk = Conversation(operator, session, around.hands)
        self._talk.kind = plan.facts
        self._consent = Consent(self._rig, self._talk)
        self._step = plan.steps[0]
        self._watch: Watching | None = None
        self._known: Known = {}
        self._result: SessionResult | None = None
        self.over = threading.Event()
        """Set when the bench is free again."""

    # --- from outside

    def ask_to_stop(self) -> None:
        """End after what is being done now: this exposure, this move. From any thread."""
        self._talk.stopping.set()

    def stop_now(self) -> None:
        """Stop everything that moves, and end. From any thread; waits for nothing."""
        self._talk.emergency.set()
        self._rig.emergency_stop()

    def go(self) -> RunEnded:
        """Carry the plan out from the first step that is not done. Blocks until the end; never raises Stopped."""
        try:
            return self._go_through()
        finally:
            self.over.set()

    def _go_through(self) -> RunEnded:
        done = self._session.state.done
        gave = {name: self.plan.step(name).gave(self._talk.facts) for name in done}
        self._talk.hear(RunBegan(self.plan, self._session.folder, tuple(done), gave))
        try:
            self._tell_notices()
            if self._next() is not None:
                self._prepare(resumed=bool(done))
            while (step := self._next()) is not None:
                self._carry_out(step)
            ended = RunEnded("finished", self._report(), self._certificate())
        except ProcedureError as error:
            self._talk.hear(Trouble(error.reason, error.remedy))
            ended = RunEnded("stopped")
        except Stopped:
            ended = RunEnded("emergency" if self._talk.emergency.is_set() else "stopped")
        except BaseException:  # a fault of the program, or its end: nothing may move on behind it
            self.stop_now()
            with suppress(Exception):
                self._ended(RunEnded("emergency"))
            raise
        return self._ended(ended)

    def _tell_notices(self) -> None:
        """What the session has mended, and what will have to be repeated."""
        for notice in self._session.state.notices:
            self._talk.hear(Doing(notice, lasts=True))
        self._session.told()

    def _report(self) -> Path | None:
        """The session's report, drawn when all is done; None where there is no result to draw."""
        if not self._session.state.results:
            return None
        from station.guide.session_report import REPORTED, session_page  # here: it draws, and that import is slow

        drawn = self._session.folder / self._session.state.results[-1].folder / PAGE
        if drawn.is_file():
            return drawn
        path = self._session.folder / PAGE
        self._talk.hear(Doing("writing the report"))
        try:
            page = session_page(self._session.folder, self._result).encode()
            self._talk.attempt(lambda: write_whole(path, page), always=True)
            self._session.note(REPORTED, sha256=hashlib.sha256(page).hexdigest())
        except (Refused, Skipped):  # of a plan that draws a page of its own, where there is something to draw
            return None
        return path

    def _certificate(self) -> Path | None:
        """The certificate of a session with a specification; None where there is nothing that it could tell."""
        if not self._session.state.results:
            return None
        from station.guide.session_report import certificate_files  # here: it draws, and that import is slow
        from station.reports.certificate import PAGE as CERTIFICATE
        from station.sessions.session_terms import terms_of_session

        folder = self._session.folder
        if not terms_of_session(folder).specification.limits:
            return None
        if self._result is None and (folder / CERTIFICATE).is_file():  # an earlier run's, of the same result
            return folder / CERTIFICATE
        try:
            for name, data in certificate_files(folder, self._result).items():
                self._talk.attempt(lambda n=name, d=data: write_whole(folder / n, d), always=True)  # type: ignore[misc]
        except (Refused, Skipped):  # of a plan whose result is no PSF, or a full disk
            return None
        return folder / CERTIFICATE

    def _ended(self, ended: RunEnded) -> RunEnded:
        with suppress(ProcedureError):  # a full disk: the run ends all the same
            self._tell_notices()
            for stop in self._rig.stops():
                self._session.note("halted", **stop.record())
            self._session.end(ended.how)
        ended = replace(ended, empty=self._session.state.empty)
        if self._rig.bench is not None:
            self._rig.bench.log_wires(None)
        self._talk.hear(ended)
        return ended

    # --- steps

    def _prepare(self, *, resumed: bool) -> None:
        """Connect everything; after an interruption, bring the axes and the lamp back to where they were."""
        if self._rig.bench is not None:
            self._rig.bench.log_wires(self._session.wire_folder())
        for name in self._rig.unconnected():
            self._talk.doing(f"connecting the {name}")
            try:
                self._talk.attempt(lambda name=name: self._rig.connect(name))  # type: ignore[misc]
            except Skipped:
                self._rig.left_out.add(name)
        if self._rig.bench is not None:
            told = {name: asdict(identity) for name, identity in self._rig.bench.identities.items()}
            self._talk.attempt(lambda: self._session.note("devices", devices=told))
        for name, doubt in self._rig.doubts().items():
            self._talk.hear(Trouble(f"{name}: {doubt.reason}", doubt.remedy))
            self._talk.attempt(lambda n=name, d=doubt: self._session.note("doubted", device=n, reason=d.reason))  # type: ignore[misc]
        if resumed:
            self._restore()

    def _restore(self) -> None:
        facts = self._talk.facts
        places = {name.removeprefix(AT): float(value) for name, value in facts.items() if name.startswith(AT)}
        if LIGHT_LEVEL in facts:
            self._do(SetLight(lambda facts: float(facts[LIGHT_LEVEL])))
        if places:
            self._unless_skipped(lambda: self._go_back(places))
        self._talk.take_up()

    def _go_back(self, places: Mapping[str, float]) -> None:
        """Home, and go to where an earlier run stood: one consent for both."""
        if self._rig.movers():
            self._consent.to_home(places)
        self._carry(Home())
        self._carry(Go(lambda facts: places, lambda facts: "going back to where the camera was"))

    def _next(self) -> Step | None:
        """The first that is not done; steps that were passed by, as a plan did that had them not, are none."""
        steps, done = self.plan.steps, self._session.state.done
        last = max((n for n, step in enumerate(steps) if step.name in done), default=-1)
        waiting = (step for n, step in enumerate(steps) if step.name not in done and (n > last or self._wanted(step)))
        return next(waiting, None)

    def _wanted(self, step: Step) -> bool:
        """Whether anything of it is asked or done."""
        return step.when(self._talk.facts)

    def _carry_out(self, step: Step) -> None:
        self._step = step
        self._session.begin_step(step.name)
        wanted = self._wanted(step)
        if wanted:
            self._talk.hear(StepBegan(step))
        try:
            for request in step.requests if wanted else ():
                self._do(request)
        except Reopened:
            return
        self._session.finish_step(step.name)
        self._talk.hear(StepEnded(step, step.gave(self._talk.facts)))

    def _do(self, request: Request) -> None:
        self._unless_skipped(lambda: self._carry(request))

    def _unless_skipped(self, work: Callable[[], None]) -> None:
        """One request, whose moves the operator begins once."""
        self._talk.check()
        self._consent.withdraw()
        try:
            work()
        except Skipped:
            self._rig.leave_out_lost()
            self._talk.hear(Doing("skipped; the run goes on with what is known", lasts=True))

    # --- requests

    @singledispatchmethod
    def _carry(self, request: Request) -> None:
        raise TypeError(f"no plan asks for {request!r}")

    @_carry.register
    def _(self, ask: Ask) -> None:
        facts = {**self._talk.facts, **self._rig.abilities()}
        if not ask.when(facts):
            return
        if (given := ask.given(facts)) is not None:
            if ask.kind != "confirm":
                self._talk.learn({ask.key: given})
            return
        if ask.kind == "confirm":
            self._talk.learn({ask.key: self._talk.confirmed(ask)})
        else:
            self._talk.learn({ask.key: self._talk.agreed(ask)})

    @_carry.register
    def _(self, give: Give) -> None:
        path = self._session.folder / give.name
        data = give.make(self._talk.facts)
        self._talk.attempt(lambda: write_whole(path, data))
        self._talk.doing(give.say(str(path)), lasts=True)

    @_carry.register
    def _(self, show: Show) -> None:
        diagram = show.diagram(self._talk.facts)
        if diagram is not None:
            self._talk.hear(Shown(diagram))

    @_carry.register
    def _(self, home: Home) -> None:
        if self._rig.movers():
            self._consent.to_home()
            self._talk.doing("homing: keep clear of everything that moves")
            self._talk.attempt(self._rig.home, self._rig.mend)
            self._moved()

    @_carry.register
    def _(self, go: Go) -> None:
        self._go(go)

    def _go(self, go: Go, *, again: bool = False) -> None:
        """`again`: other places of the same request follow."""
        facts = {**self._talk.facts, **self._rig.snapshot().facts()}
        places, say = go.to(facts), go.say(facts)
        if not say:
            return
        obstacle = self._rig.obstacle(places)
        if obstacle is None:
            self._consent.to_go(places, again=again)
            self._talk.doing(say)
            self._talk.attempt(lambda: self._rig.go_to(places), self._rig.mend)
            self._moved()
        else:
            self._talk.by_hand(Advice(False, say, by_hand=go.by_hand(facts)), obstacle)
            self._consent.withdraw()

    @_carry.register
    def _(self, light: SetLight) -> None:
        level = light.level(self._talk.facts)
        if self._talk.attempt(lambda: self._rig.set_light(level), self._rig.mend):
            self._talk.learn({LIGHT_LEVEL: level})

    @_carry.register
    def _(self, measure: Measure) -> None:
        distance_mm = self._talk.attempt(self._rig.measure_mm, self._rig.mend)
        if distance_mm is not None:
            self._talk.learn({DISTANCE: distance_mm})

    @_carry.register
    def _(self, look: Look) -> None:
        if look.when(self._talk.facts):
            self._watching().look(look)

    @_carry.register
    def _(self, scan: Scan) -> None:
        self._watching().scan(scan)

    @_carry.register
    def _(self, shoot: Shoot) -> None:
        self._watching().shoot(shoot)

    @_carry.register
    def _(self, tour: Tour) -> None:
        self._watching().tour(tour, self._visit)

    def _visit(self, go: Go) -> None:
        """One place of a tour: its first move is begun for all of them."""
        self._go(go, again=True)

    @_carry.register
    def _(self, estimate: Estimate) -> None:
        say = "estimating from all shots that count"
        self._talk.doing(say)

        def told(done: int, total: int) -> None:
            self._talk.hear(Doing(say, done, total))

        folder, found = self._talk.attempt(lambda: derive(self._session, self.plan, self._step.name, told, self._known))
        self._result = found
        self._talk.learn(estimate.tells({name: one.found for name, one in found.planes.items()}))
        self._talk.hear(Result(folder, found.planes, found.verdict, found.reason, found.remedy, found.other_causes))

    @_carry.register
    def _(self, decide: Decide) -> None:
        choices = (RETAKE, ACCEPT) if decide.again(self._talk.facts) else (ACCEPT, RETAKE)
        if self._talk.choose("verdict", "Accept it, or take the shots again?", choices) == RETAKE:
            self._session.reopen(decide.retake)
            raise Reopened

    # --- photographs

    def _watching(self) -> Watching:
        """What looks through the camera: the bench's, or the operator's own."""
        if self._watch is None:
            camera: Photographer = self._rig
            if not self._rig.has_camera:
                camera = self._talk.attempt(lambda: HandCamera(self._talk.ask_and_learn, self._clock))
            exposer = Exposer(self._rig, camera, self._session, self._talk, self._clock, self._patience)
            self._watch = Watching(self._rig, exposer, self._session, self._talk, self._known, self._consent)
            self._watch.asks = self.plan.asks()
        self._watch.step = self._step.name
        return self._watch

    def _moved(self) -> None:
        self._watching().moved()
