"""Runs a plan: asks, moves, settles, exposes, checks. The only code that measures through drivers.

Every photograph is stored in the session before it is read. Every error of a device or of the disk becomes a message
and a question: try again, skip, or stop.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, replace
from functools import singledispatchmethod
from pathlib import Path
from typing import TYPE_CHECKING

from drivers.errors import DeviceError, SystemClock
from procedures import plan as plans
from procedures.outcome import ProcedureError, Refused
from station.bench.opening import STILL_LIT, SWITCH_OFF, Surroundings
from station.common.durable_files import write_whole
from station.guide import frontend
from station.guide.active_devices import AT, DISTANCE, LIGHT_LEVEL, ActiveDevices
from station.guide.consent import MoveApproval
from station.guide.dialogue import Conversation, Skipped
from station.guide.exposure import Photographer, PhotographRecorder
from station.guide.manual_camera import HandCamera
from station.guide.photographing import PhotographRequests
from station.guide.session_result import SessionResult, derive
from station.guide.vibration import SettlingTimeouts
from station.sessions.session import Session

if TYPE_CHECKING:
    from station.bench.opening import Bench

PAGE = "report.html"
ACCEPT, RETAKE = "accept", "retake"


class StepReopened(Exception):
    """The operator returns to an earlier step."""


class Run:
    """A plan on a bench, or without one, with a session as memory and an operator."""

    def __init__(
        self,
        plan: plans.Plan,
        bench: Bench | None,
        session: Session,
        operator: frontend.Frontend,
        timeouts: SettlingTimeouts | None = None,
    ) -> None:
        self.plan = plan
        self._session = session
        self._timeouts = timeouts
        self._rig = ActiveDevices(bench)
        self._clock = bench.clock if bench else SystemClock()
        surroundings = bench.surroundings if bench else Surroundings()
        surroundings.stand_before(plan.subject)
        self._talk = Conversation(operator, session, surroundings.hands, plan.facts)
        self._approval = MoveApproval(self._rig, self._talk)
        self._step = plan.steps[0]
        self._photographs: PhotographRequests | None = None
        self._known: plans.Known = {}
        self._result: SessionResult | None = None
        self.over = threading.Event()
        """Set when the run has released the bench."""

    def ask_to_stop(self) -> None:
        """End after the current exposure or move. From any thread."""
        self._talk.stopping.set()

    def stop_now(self) -> None:
        """Stop every device, and end. From any thread; returns at once."""
        self._talk.emergency.set()
        self._rig.emergency_stop()

    def go(self) -> frontend.RunEnded:
        """Carry out the plan from the first incomplete step. Blocks until the end; never raises Stopped."""
        try:
            done = self._session.state.done
            gave = {name: self.plan.step(name).value(self._talk.facts) for name in done}
            self._talk.notify(frontend.RunBegan(self.plan, self._session.folder, tuple(done), gave))
            try:
                self._report_notices()
                if self._next() is not None:
                    self._prepare(resumed=bool(done))
                while (step := self._next()) is not None:
                    self._carry_out(step)
                ended = frontend.RunEnded("finished", self._report(), self._certificate())
            except ProcedureError as error:
                self._talk.notify(frontend.ProblemEvent(error.reason, error.remedy))
                ended = frontend.RunEnded("stopped")
            except frontend.Stopped:
                ended = frontend.RunEnded("emergency" if self._talk.emergency.is_set() else "stopped")
            except BaseException:  # an unexpected error or exit: nothing may keep moving
                self.stop_now()
                with suppress(Exception):
                    self._ended(frontend.RunEnded("emergency"))
                raise
            return self._ended(ended)
        finally:
            self.over.set()

    def _report_notices(self) -> None:
        """Report what the session has recovered, and what must be repeated."""
        for notice in self._session.state.notices:
            self._talk.notify(frontend.ProgressEvent(notice, lasts=True))
        self._session.acknowledge_notices()

    def _report(self) -> Path | None:
        """The session's report, written at the end; None without a result."""
        if not self._session.state.results:
            return None
        from station.guide.session_report import REPORTED, session_page  # imported here: it draws, a slow import

        drawn = self._session.folder / self._session.state.results[-1].folder / PAGE
        if drawn.is_file():
            return drawn
        path = self._session.folder / PAGE
        self._talk.notify(frontend.ProgressEvent("writing the report"))
        with suppress(Refused, Skipped):  # the plan writes its own page, or was refused
            page = session_page(self._session.folder, self._result).encode()
            self._talk.attempt(lambda: write_whole(path, page), always=True)
            self._session.note(REPORTED, sha256=hashlib.sha256(page).hexdigest())
            return path
        return None

    def _certificate(self) -> Path | None:
        """The certificate of a session with a specification; None where the plan has none."""
        from station.guide.session_report import certificate_files  # imported here: it draws, a slow import
        from station.reports.certificate import PAGE as CERTIFICATE
        from station.sessions.state import terms_of_session

        folder = self._session.folder
        if not (self._session.state.results and terms_of_session(folder).specification.limits):
            return None
        if self._result is None and (folder / CERTIFICATE).is_file():  # from an earlier run, of the same result
            return folder / CERTIFICATE
        with suppress(Refused, Skipped):  # the result is not a PSF, or the disk is full
            for name, data in certificate_files(folder, self._result).items():
                self._talk.attempt(lambda n=name, d=data: write_whole(folder / n, d), always=True)  # type: ignore[misc]
            return folder / CERTIFICATE
        return None

    def _ended(self, ended: frontend.RunEnded) -> frontend.RunEnded:
        try:
            self._rig.extinguish()
        except DeviceError as error:
            self._talk.notify(frontend.ProblemEvent(STILL_LIT.format(error.reason), SWITCH_OFF))
        stops = self._rig.stops()
        if unsent := {name for stop in stops for name, sent_s in stop.wires.items() if sent_s is None}:
            reason = f"the stop could not be sent to {', '.join(sorted(unsent))}"
            self._talk.notify(frontend.ProblemEvent(reason, "stop it at the bench, as it may still move"))
        with suppress(ProcedureError):  # the run also ends on a full disk
            self._report_notices()
            for stop in stops:
                self._session.note("halted", **stop.record())
            self._session.end(ended.how)
        ended = replace(ended, empty=self._session.state.empty)
        if self._rig.bench is not None:
            self._rig.bench.log_wires(None)
        self._talk.notify(ended)
        return ended

    def _prepare(self, *, resumed: bool) -> None:
        """Connect every device; after an interruption, restore the positions of the axes and the lamp."""
        if self._rig.bench is not None:
            self._rig.bench.log_wires(self._session.wire_folder())
        for name in self._rig.unconnected():
            self._talk.doing(f"connecting the {name}")
            try:
                self._talk.attempt(lambda name=name: self._rig.connect(name))  # type: ignore[misc]
            except Skipped:
                self._rig.excluded.add(name)
        if self._rig.bench is not None:
            identities = {name: asdict(identity) for name, identity in self._rig.bench.identities.items()}
            self._talk.attempt(lambda: self._session.note("devices", devices=identities))
        for name, caveat in self._rig.caveats().items():
            self._talk.notify(frontend.ProblemEvent(f"{name}: {caveat.reason}", caveat.remedy))
            self._talk.attempt(lambda n=name, c=caveat: self._session.note("caveat", device=n, reason=c.reason))  # type: ignore[misc]
        if resumed:
            self._restore()

    def _restore(self) -> None:
        facts = self._talk.facts
        places = {name.removeprefix(AT): float(value) for name, value in facts.items() if name.startswith(AT)}
        if LIGHT_LEVEL in facts:
            self._do(plans.SetLight(lambda facts: float(facts[LIGHT_LEVEL])))

        def go_back() -> None:
            if self._rig.movers():
                self._approval.to_home(places)
            self._carry(plans.Home())
            self._carry(plans.Go(lambda facts: places, lambda facts: "returning the camera to its last position"))

        if places:
            self._unless_skipped(go_back)
        self._talk.take_up()

    def _next(self) -> plans.Step | None:
        """The first incomplete step; unwanted steps before the last completed one are skipped."""
        steps, done, facts = self.plan.steps, self._session.state.done, self._talk.facts
        last = max((n for n, step in enumerate(steps) if step.name in done), default=-1)
        left = (step for n, step in enumerate(steps) if step.name not in done and (n > last or step.when(facts)))
        return next(left, None)

    def _carry_out(self, step: plans.Step) -> None:
        self._step = step
        self._session.begin_step(step.name)
        wanted = step.when(self._talk.facts)
        if wanted:
            self._talk.notify(frontend.StepBegan(step))
        try:
            for request in step.requests if wanted else ():
                self._do(request)
        except StepReopened:
            return
        self._session.finish_step(step.name)
        self._talk.notify(frontend.StepEnded(step, step.value(self._talk.facts)))

    def _do(self, request: plans.Request) -> None:
        self._unless_skipped(lambda: self._carry(request))

    def _unless_skipped(self, work: Callable[[], None]) -> None:
        self._talk.check()
        self._approval.withdraw()
        try:
            work()
        except Skipped:
            self._rig.exclude_lost()
            self._talk.notify(frontend.ProgressEvent("skipped; the run continues with what is known", lasts=True))

    @singledispatchmethod
    def _carry(self, request: plans.Request) -> None:
        raise TypeError(f"unknown request: {request!r}")

    @_carry.register
    def _(self, ask: plans.Ask) -> None:
        facts = {**self._talk.facts, **self._rig.abilities()}
        if not ask.when(facts):
            return
        if (given := ask.given(facts)) is None:
            self._talk.learn({ask.key: self._talk.confirmed(ask) if ask.kind == "confirm" else self._talk.agreed(ask)})
        elif ask.kind != "confirm":
            self._talk.learn({ask.key: given})

    @_carry.register
    def _(self, give: plans.Give) -> None:
        path = self._session.folder / give.name
        data = give.make(self._talk.facts)
        self._talk.attempt(lambda: write_whole(path, data))
        self._talk.doing(give.say(str(path)), lasts=True)

    @_carry.register
    def _(self, show: plans.Show) -> None:
        diagram = show.diagram(self._talk.facts)
        if diagram is not None:
            self._talk.notify(frontend.DiagramEvent(diagram))

    @_carry.register
    def _(self, home: plans.Home) -> None:
        if self._rig.movers():
            self._approval.to_home()
            self._talk.doing("homing: keep clear of all moving parts")
            self._talk.attempt(self._rig.home, self._rig.recover)
            self._photograph_requests().moved()

    @_carry.register
    def _(self, go: plans.Go) -> None:
        self._go(go)

    def _go(self, go: plans.Go, *, again: bool = False) -> None:
        """Move, with the bench or by hand; `again` : more moves of the request follow."""
        facts = {**self._talk.facts, **self._rig.snapshot().facts()}
        places, say = go.to(facts), go.say(facts)
        if not say:
            return
        obstacle = self._rig.obstacle(places)
        if obstacle is None:
            self._approval.to_go(places, again=again)
            self._talk.doing(say)
            self._talk.attempt(lambda: self._rig.go_to(places), self._rig.recover)
            self._photograph_requests().moved()
        else:
            self._talk.by_hand(plans.Advice(False, say, by_hand=go.by_hand(facts)), obstacle)
            self._approval.withdraw()

    @_carry.register
    def _(self, light: plans.SetLight) -> None:
        level = light.level(self._talk.facts)
        self._approval.to_light(level)
        self._talk.notify(
            frontend.ProgressEvent(f"the lamp goes to {100 * level:.0f} %" if level else "the lamp goes out")
        )
        if self._talk.attempt(lambda: self._rig.set_light(level), self._rig.recover):
            self._talk.learn({LIGHT_LEVEL: level})

    @_carry.register
    def _(self, measure: plans.Measure) -> None:
        distance_mm = self._talk.attempt(self._rig.measure_mm, self._rig.recover)
        if distance_mm is not None:
            self._talk.learn({DISTANCE: distance_mm})

    @_carry.register
    def _(self, look: plans.Look) -> None:
        if look.when(self._talk.facts):
            self._photograph_requests().look(look)

    @_carry.register
    def _(self, scan: plans.Scan) -> None:
        self._photograph_requests().scan(scan)

    @_carry.register
    def _(self, shoot: plans.Shoot) -> None:
        self._photograph_requests().shoot(shoot)

    @_carry.register
    def _(self, tour: plans.Tour) -> None:
        self._photograph_requests().tour(tour, lambda go: self._go(go, again=True))

    @_carry.register
    def _(self, estimate: plans.Estimate) -> None:
        say = "computing the result from all shots that count"
        self._talk.doing(say)

        def progress(done: int, total: int) -> None:
            self._talk.notify(frontend.ProgressEvent(say, done, total))

        folder, result = self._talk.attempt(
            lambda: derive(self._session, self.plan, self._step.name, progress, self._known)
        )
        self._result = result
        self._talk.learn(estimate.facts_from({name: plane.estimate for name, plane in result.planes.items()}))
        causes = result.reason, result.remedy, result.other_causes
        self._talk.notify(frontend.Result(folder, result.planes, result.verdict, *causes))

    @_carry.register
    def _(self, decide: plans.Decide) -> None:
        choices = (RETAKE, ACCEPT) if decide.again(self._talk.facts) else (ACCEPT, RETAKE)
        if self._talk.choose("verdict", "Accept the result, or take the shots again?", choices) == RETAKE:
            self._session.reopen(decide.retake)
            raise StepReopened

    def _photograph_requests(self) -> PhotographRequests:
        """The photograph requests, with the bench's camera or the operator's own."""
        if self._photographs is None:
            camera: Photographer = self._rig
            if not self._rig.has_camera:
                camera = self._talk.attempt(
                    lambda: HandCamera(self._talk.ask_and_learn, self._clock, self._talk.meanwhile)
                )
            recorder = PhotographRecorder(self._rig, camera, self._session, self._talk, self._clock, self._timeouts)
            self._photographs = PhotographRequests(recorder, self._known, self._approval, self.plan.asks())
        self._photographs.step = self._step.name
        return self._photographs
