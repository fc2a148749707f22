"""Requests of a plan that need photographs: look and correct until good, scan an axis, take shots that count."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

from procedures.advice import time_words
from procedures.outcome import Verdict
from procedures.plan import (
    INSISTED,
    Advice,
    Ask,
    Fact,
    Facts,
    Go,
    Goal,
    Known,
    Look,
    Outcomes,
    Scan,
    Shoot,
    Tour,
    TourStop,
)
from procedures.raw import RawFrame
from station.bench.axis_text import moves_text
from station.guide.active_devices import AT
from station.guide.answers import words
from station.guide.coach import Ended, until_held
from station.guide.consent import MoveApproval
from station.guide.dialogue import AGAIN, STOP, Coach, Conversation, Skipped
from station.guide.exposure import PhotographRecorder, RecordedPhotograph
from station.guide.frontend import FrameEvent, GoalEvent, ProblemEvent, ProgressEvent, ScanEvent, Stopped
from station.guide.manual_camera import HandCamera
from station.sessions.journal import same_bits
from station.sessions.session import SessionShot

CORRECT, INSIST = "correct it", "it is right"
MAX_STALLED = 3
"""Consecutive moves, or new answers, without improvement."""
IMPROVEMENT_FACTOR = 0.9
"""An improvement reduces the deviation from the tolerance to at most this factor times the previous one."""
REMEDY = "correct the numbers, or confirm them"


@dataclass
class LookProgress:
    """Convergence of consecutive looks: the deviations of one reading from its tolerance."""

    name: str = ""
    deviations: list[float] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    contradictions: int = 0

    def stalled(self, advice: Advice) -> str:
        """Why further moves do not help; "" unless three moves have brought a reading no nearer."""
        bad = next((reading for reading in advice.readings if not reading.good), None)
        if advice.good or not advice.moves or bad is None:
            self.deviations.clear()
            self.values.clear()
            return ""
        if bad.name != self.name:
            self.name, self.deviations, self.values = bad.name, [], []
        low, high = bad.value if bad.low is None else bad.low, bad.value if bad.high is None else bad.high
        self.deviations.append(max(low - bad.value, bad.value - high))
        self.values.append(bad.value)
        last = self.deviations[-MAX_STALLED - 1 :]
        if len(last) <= MAX_STALLED or any(now <= IMPROVEMENT_FACTOR * before for before, now in pairwise(last)):
            return ""
        values = ", ".join(f"{value:.3g}" for value in self.values[-MAX_STALLED - 1 :])
        stalled = f"{MAX_STALLED} moves have not brought the {bad.name} nearer to its tolerance"
        return f"{stalled}: it was {values} {bad.unit}".rstrip() + "."

    def exhausted(self) -> bool:
        """Count one more contradiction; whether there have been too many."""
        self.contradictions += 1
        return self.contradictions >= MAX_STALLED


def resolve(talk: Conversation, asks: Mapping[str, Ask], reason: str, keys: tuple[str, ...], *, last: bool) -> None:
    """Report a contradiction; the operator corrects or confirms, or, the `last` time, stops. Raises Stopped."""
    known = tuple(key for key in keys if key in asks)
    answers = {key: words(talk.facts[key], asks[key].unit) for key in known if key in talk.facts}
    given = " ".join(f"{asks[key].question} {answer}." for key, answer in answers.items())
    talk.notify(ProblemEvent(f"{reason} Given: {given}" if given else reason, REMEDY if known else "check the rig"))
    if last:
        raise Stopped
    answer = talk.choose("contradiction", "What now?", (*((CORRECT, INSIST) if known else (GO_ON,)), STOP))
    for key in known:
        talk.learn({INSISTED + key: True} if answer == INSIST else {key: talk.ask(asks[key]), INSISTED + key: False})


Check = Callable[[RawFrame, Facts], Advice]
EXPOSURE = "exposure_ev"
LOOK_AGAIN, GO_ON = "look again", "go on"
SKIP_PLACE = "skip it"
PREVIEW = ("G1", "Y")


@dataclass(frozen=True)
class AdviceAction:
    """How an advice is carried out.

    shown : the advice as shown to the operator, who is not asked for what the bench does itself
    target : positions to which the bench moves, by axis
    exposure_s : exposure time set through the camera's cable
    obstacle : why the bench cannot move there
    """

    shown: Advice
    target: Mapping[str, float] = field(default_factory=dict)
    exposure_s: float | None = None
    obstacle: str = ""


class PhotographRequests:
    """Carries out the requests of a plan that need photographs."""

    def __init__(
        self, recorder: PhotographRecorder, known: Known, approval: MoveApproval, asks: Mapping[str, Ask]
    ) -> None:
        self._recorder, self._known, self._approval, self._asks = recorder, known, approval, asks
        self._rig, self._session, self._talk = recorder.rig, recorder.session, recorder.talk
        self.step = ""
        self._progress = LookProgress()

    def moved(self) -> None:
        """After a movement: store positions and travel limits, and wait for the rig to settle."""
        self._recorder.settling.moved()
        self._talk.learn(self._talk.attempt(self._rig.axis_facts, self._rig.recover))

    def look(self, look: Look) -> None:
        """Look and correct until the check passes or the operator accepts. Raises Skipped, Stopped."""
        progress = LookProgress()
        while not any(self._look_once(look, progress) for _ in range(look.tries)):
            question = f"Still outside the tolerance after {look.tries} frames. Look again, or go on with it unchanged?"
            if self._talk.choose("look", question, (LOOK_AGAIN, GO_ON, STOP)) == GO_ON:
                return

    def _look_once(self, look: Look, progress: LookProgress) -> bool:
        taken = self._recorder.take(look.purpose, self.step)
        advice = self._talk.attempt(lambda: look.check(taken.frame, taken.facts))
        self._session.judge(taken.shot, False, "a trial" if advice.good else advice.say)
        action = self._action(advice, taken.frame)
        self._show(taken.frame, action.shown)
        self._talk.learn_from_photograph(advice.facts)
        stalled = progress.stalled(advice)
        if advice.contradictory or stalled:
            keys = advice.contradictory or look.rests_on
            resolve(self._talk, self._asks, stalled or advice.say, keys, last=bool(stalled) or progress.exhausted())
        else:
            self._carry_out(action, look.check)
        return advice.good

    def _show(self, frame: RawFrame, advice: Advice, hold_s: float | None = None) -> None:
        self._report(advice.goal)
        name = next((name for name in PREVIEW if name in frame.planes), next(iter(frame.planes)))
        self._talk.notify(FrameEvent(frame.planes[name], advice, hold_s))

    def _action(self, advice: Advice, frame: RawFrame) -> AdviceAction:
        """How the advice is carried out: by the bench or the camera's cable where possible, else by hand."""
        if advice.good:
            return AdviceAction(advice)
        exposure_s = frame.exposure.exposure_s
        if set(advice.by_hand) == {EXPOSURE} and exposure_s is not None and self._rig.sets_exposure:
            wanted_s = exposure_s * 2 ** advice.by_hand[EXPOSURE]
            say = f"Setting the exposure time to {time_words(wanted_s)} through the camera's cable."
            return AdviceAction(replace(advice, say=say), exposure_s=wanted_s)
        target = self._talk.attempt(lambda: self._rig.target(advice.moves), self._rig.recover)
        obstacle = self._rig.obstacle(target)
        if obstacle is not None:
            return AdviceAction(advice, obstacle=obstacle)
        return AdviceAction(replace(advice, say=f"The bench corrects this: {moves_text(target)}."), target=target)

    def _carry_out(self, action: AdviceAction, check: Check) -> None:
        if action.exposure_s is not None:
            wanted_s = action.exposure_s
            self._talk.doing(f"setting the exposure time to {time_words(wanted_s)}")
            self._talk.attempt(lambda: self._rig.set_exposure(wanted_s), self._rig.recover)
        elif action.target:
            self._approval.to_go(action.target, again=True)
            self._go_to(action.target)
        elif not action.shown.good:
            self._by_hand(action.shown, action.obstacle, self._coach(action.shown, check))

    def _coach(self, advice: Advice, check: Check) -> Coach | None:
        """The coach while the operator corrects a pose; of the operator's own camera, the next photograph."""
        if isinstance(self._recorder.camera, HandCamera):
            return self._recorder.camera.after_correction
        if advice.outline is None:
            return None

        def coach(ended: Ended) -> bool:
            facts: dict[str, Fact] = {}

            def preview() -> RawFrame:
                frame, now = self._recorder.preview()
                facts.update(now)
                return frame

            def held(advice: Advice) -> bool:
                return advice.good or self._rig.obstacle(self._rig.target(advice.moves)) is None

            return until_held(preview, lambda frame: check(frame, facts), self._show, held, ended)

        return coach

    def _by_hand(self, advice: Advice, why: str = "", coach: Coach | None = None) -> None:
        """Ask the operator to do it. Somebody is at the rig then: the next move needs a new approval."""
        self._talk.by_hand(advice, why, coach)
        self._approval.withdraw()
        self._recorder.settling.moved()

    def _go_to(self, places: Mapping[str, float]) -> None:
        self._talk.doing(f"moving {moves_text(places)}: keep clear")
        self._talk.attempt(lambda: self._rig.go_to(places), self._rig.recover)
        self.moved()

    def scan(self, scan: Scan) -> None:
        """A trial frame at each position, then move to the best. Raises Skipped, Stopped."""
        places = [float(place) for place in scan.places(self._talk.facts)]
        here, scores = 0.0, []  # an axis that is set by hand starts at 0
        if scan.axis in self._rig.axes():
            here = float(self._talk.facts.get(AT + scan.axis, 0.0))
            if places:
                self._approval.to_scan(scan.axis, places)
        for i, place in enumerate(places):
            self._set(scan, place, here)
            here = place
            self._talk.doing(scan.purpose, i + 1, len(places))
            taken = self._recorder.take(scan.purpose, self.step)
            scores.append(self._talk.attempt(lambda t=taken: scan.score(t.frame, t.facts)))  # type: ignore[misc]
            self._session.judge(taken.shot, False, "a trial")
            self._show(taken.frame, Advice(True, ""))
            self._talk.notify(ScanEvent(scan.axis, tuple(places[: i + 1]), tuple(scores), scan.quantity))
        if places:
            advice = scan.choose(places, scores)
            self._talk.learn_from_photograph(advice.facts)
            self._talk.doing(advice.say, lasts=True)
            self._set(scan, here + advice.moves.get(scan.axis, 0.0), here)

    def _set(self, scan: Scan, place: float, here: float) -> None:
        """Move the axis to a position, by the bench or by hand."""
        if scan.axis in self._rig.axes():
            self._go_to({scan.axis: place})
        elif place != here:
            self._by_hand(Advice(False, scan.say(place - here), by_hand={scan.axis: place - here}))

    def shoot(self, shoot: Shoot) -> None:
        """Take shots until there are enough, after checking those of an interrupted run. Raises Stopped."""
        results: list[Outcomes] = []
        self._progress = LookProgress()
        for shot in self._earlier(shoot.purpose):
            self._judge(shoot, self._recorder.read(shot), results)
        for _ in range(shoot.most):
            if results and self._enough(shoot, results):
                return
            shake = shoot.shake(self._talk.facts)
            taken = self._recorder.take(shoot.purpose, self.step, moving=shoot.record_motion, shake=shake)
            self._judge(shoot, taken, results)
        if not (results and self._enough(shoot, results)):
            self._talk.doing(f"{shoot.most} shots taken; continuing with those that count", lasts=True)

    def _earlier(self, purpose: str) -> list[SessionShot]:
        """The shots of this step and purpose that count, or were not checked before the interruption."""
        shots = self._session.state.shots
        return [s for s in shots if (s.step, s.purpose) == (self.step, purpose) and s.counts is not False]

    def _enough(self, shoot: Shoot, results: list[Outcomes]) -> bool:
        advice = shoot.enough(results, {**self._talk.facts, **self._rig.abilities()})
        self._talk.learn_from_photograph(advice.facts)
        if advice.contradictory:
            resolve(self._talk, self._asks, advice.say, advice.contradictory, last=self._progress.exhausted())
            return False
        self._report(advice.goal)
        self._talk.doing(advice.say, len(results), shoot.most, lasts=True)
        return advice.good

    def _report(self, goal: Goal | None) -> None:
        if goal is not None:
            self._talk.notify(GoalEvent(goal))

    def _judge(self, shoot: Shoot, taken: RecordedPhotograph, results: list[Outcomes]) -> None:
        """Decide whether a shot counts, and add its estimate to the results."""
        advice = self._talk.attempt(lambda: shoot.check(taken.frame, taken.facts))
        if advice.good:
            self._talk.notify(ProgressEvent(f"estimating from shot {taken.shot.number}"))
            with same_bits():  # the final result reuses these estimates
                outcomes = self._talk.attempt(lambda: shoot.estimate(taken.frame, taken.facts, results, self._known))
            refused = [outcome for outcome in outcomes.values() if outcome.verdict is Verdict.REFUSED]
            if len(refused) < len(outcomes):
                results.append(outcomes)
            else:
                advice = Advice(False, f"{refused[0].reason}: {refused[0].remedy}")
        action = self._record(taken, advice)
        if advice.contradictory:
            resolve(self._talk, self._asks, advice.say, advice.contradictory, last=self._progress.exhausted())
        else:
            self._carry_out(action, shoot.check)

    def _record(self, taken: RecordedPhotograph, advice: Advice) -> AdviceAction:
        """Record whether the shot counts, show it, and derive how to carry out the advice."""
        if advice.good:
            self._talk.learn_from_photograph(advice.facts)
        self._session.judge(taken.shot, advice.good, "" if advice.good else advice.say)
        action = self._action(advice, taken.frame)
        self._show(taken.frame, action.shown)
        return action

    def tour(self, tour: Tour, go: Callable[[Go], None]) -> None:
        """Take a shot that counts at each place that has none yet; `go` moves there. Raises Stopped."""
        stops = tour.stops(self._talk.facts)
        for number, stop in enumerate(stops, 1):
            if self._visited(stop):
                continue
            self._talk.doing(stop.name, number, len(stops))
            self._report(stop.goal(self._talk.facts) or Goal(len(stops) - number + 1))
            reason = self._visit(stop, tour.tries, go)
            if reason:
                self._session.note("left_out", step=self.step, place=stop.name, reason=reason)
                self._talk.notify(ProgressEvent(f"{stop.name} is skipped: {reason}", lasts=True))

    def _visited(self, stop: TourStop) -> bool:
        """Whether a shot of this place counts; one left unchecked by an interruption is checked now."""
        for shot in self._earlier(stop.name):
            if shot.counts is None:
                taken = self._recorder.read(shot)
                self._record(taken, self._talk.attempt(lambda t=taken: stop.check(t.frame, t.facts)))  # type: ignore[misc]
        return any(shot.counts for shot in self._earlier(stop.name))

    def _visit(self, stop: TourStop, tries: int, go: Callable[[Go], None]) -> str:
        """Go there and try until a shot counts. Gives "", or why the place is skipped."""
        try:
            go(stop.go)
            while True:
                for _ in range(tries):
                    taken = self._recorder.take(stop.name, self.step)
                    advice = self._talk.attempt(lambda t=taken: stop.check(t.frame, t.facts))  # type: ignore[misc]
                    action = self._record(taken, advice)
                    if advice.good:
                        return ""
                    self._carry_out(action, stop.check)
                question = f"{stop.name}: none of {tries} shots counts. Skip this place, or try again?"
                if self._talk.choose("place", question, (SKIP_PLACE, AGAIN, STOP)) != AGAIN:
                    return advice.say
        except Skipped:
            self._rig.exclude_lost()
            return "the operator skipped it"
