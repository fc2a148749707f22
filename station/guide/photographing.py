"""What a run does with photographs: look and mend until it is good, scan an axis, take shots that count."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from procedures.advice import time_words
from procedures.outcome import Verdict
from procedures.plan import Advice, Ask, Go, Known, Look, Outcomes, Scan, Shoot, Tour, TourStop
from procedures.raw import RawFrame, read_frame
from station.bench.axis_words import in_words, label
from station.guide.active_devices import AT, Rig
from station.guide.consent import Consent
from station.guide.contradictions import LookProgress, resolve
from station.guide.dialogue import AGAIN, STOP, Conversation, Skipped
from station.guide.exposure import Exposer, Taken, shot_facts
from station.guide.frontend import CurveSeen, Doing, Seen, Stopped
from station.sessions.compute_environment import same_bits
from station.sessions.session import Session, SessionShot

EXPOSURE = "exposure_ev"
LOOK_AGAIN, GO_ON = "look again", "go on"
LEAVE_OUT = "leave it out"
PREVIEW = ("G1", "Y")
"""Of which plane a preview is shown."""


@dataclass(frozen=True)
class Way:
    """How an advice is followed.

    Attributes
    ----------
    told : the advice as the operator hears it: what the bench does is not asked of hands
    target : where the bench goes by itself, by axis
    exposure_s : what the camera is set to through its cable
    obstacle : why the bench cannot go there
    """

    told: Advice
    target: Mapping[str, float] = field(default_factory=dict)
    exposure_s: float | None = None
    obstacle: str = ""


class Watching:
    """Photographs for one purpose after the other, and what follows from them."""

    def __init__(
        self, rig: Rig, exposer: Exposer, session: Session, talk: Conversation, known: Known, consent: Consent
    ) -> None:
        self._rig = rig
        self._known = known
        self._exposer = exposer
        self._session = session
        self._talk = talk
        self._consent = consent
        self.step = ""
        self.asks: Mapping[str, Ask] = {}
        self._progress = LookProgress()

    def moved(self) -> None:
        """Something moved: keep where it is and how far it can go, and let it settle."""
        self._exposer.settling.moved()
        self._talk.learn(self._talk.attempt(self._rig.axis_facts, self._rig.mend))

    # --- look until it is good

    def look(self, look: Look) -> None:
        """Look and mend until the check is content, or the operator is. Raises Skipped, Stopped."""
        progress = LookProgress()
        while not any(self._look_once(look, progress) for _ in range(look.tries)):
            question = f"After {look.tries} looks it is not as it should be. Look again, or go on with it as it is?"
            answer = self._talk.choose("look", question, (LOOK_AGAIN, GO_ON, STOP))
            if answer == STOP:
                raise Stopped
            if answer == GO_ON:
                return

    def _look_once(self, look: Look, progress: LookProgress) -> bool:
        taken = self._exposer.take(look.purpose, self.step)
        advice = self._talk.attempt(lambda: look.check(taken.frame, taken.facts))
        self._session.judge(taken.shot, False, "a trial" if advice.good else advice.say)
        way = self._way(advice, taken.frame)
        self._show(taken.frame, way.told)
        self._talk.learn_noted(advice.facts)
        stalled = progress.stalled(advice)
        if advice.doubted or stalled:
            keys = advice.doubted or look.rests_on
            resolve(self._talk, self.asks, stalled or advice.say, keys, last=bool(stalled) or progress.doubted())
        else:
            self._follow(way)
        return advice.good

    def _show(self, frame: RawFrame, advice: Advice) -> None:
        name = next((name for name in PREVIEW if name in frame.planes), next(iter(frame.planes)))
        self._talk.hear(Seen(frame.planes[name], advice))

    def _way(self, advice: Advice, frame: RawFrame) -> Way:
        """How the advice is followed: by the bench or the camera's cable where they can, else by hand."""
        if advice.good:
            return Way(advice)
        exposure_s = frame.exposure.exposure_s
        if set(advice.by_hand) == {EXPOSURE} and exposure_s is not None and self._rig.sets_exposure:
            wanted_s = exposure_s * 2 ** advice.by_hand[EXPOSURE]
            told = f"The exposure time is set to {time_words(wanted_s)} through the camera's cable."
            return Way(replace(advice, say=told), exposure_s=wanted_s)
        target = self._talk.attempt(lambda: self._rig.target(advice.moves), self._rig.mend)
        obstacle = self._rig.obstacle(target)
        if obstacle is not None:
            return Way(advice, obstacle=obstacle)
        ends = ", ".join(f"{label(axis)} to {in_words(axis, place)}" for axis, place in target.items())
        return Way(replace(advice, say=f"The bench corrects this by itself: {ends}."), target=target)

    def _follow(self, way: Way) -> None:
        """Do what the advice says."""
        if way.exposure_s is not None:
            wanted_s = way.exposure_s
            self._talk.doing(f"setting the exposure time to {time_words(wanted_s)}")
            self._talk.attempt(lambda: self._rig.set_exposure(wanted_s), self._rig.mend)
        elif way.target:
            self._consent.to_go(way.target, again=True)
            self._go_to(way.target)
        elif not way.told.good:
            self._by_hand(way.told, way.obstacle)

    def _by_hand(self, advice: Advice, why: str = "") -> None:
        """Hands do it: they were at the rig, so the next move of the bench is begun anew."""
        self._talk.by_hand(advice, why)
        self._consent.withdraw()
        self._exposer.settling.moved()

    def _go_to(self, places: Mapping[str, float]) -> None:
        ends = ", ".join(f"{label(axis)} to {in_words(axis, place)}" for axis, place in places.items())
        self._talk.doing(f"moving {ends}: keep clear")
        self._talk.attempt(lambda: self._rig.go_to(places), self._rig.mend)
        self.moved()

    # --- scan an axis

    def scan(self, scan: Scan) -> None:
        """A trial at each place, then on to the best. Raises Skipped, Stopped."""
        places = [float(place) for place in scan.places(self._talk.facts)]
        here, scores = self._here(scan.axis), []
        if places and scan.axis in self._rig.axes():
            self._consent.to_scan(scan.axis, places)
        for i, place in enumerate(places):
            self._set(scan, place, here)
            here = place
            self._talk.doing(scan.purpose, i + 1, len(places))
            taken = self._exposer.take(scan.purpose, self.step)
            scores.append(self._talk.attempt(lambda t=taken: scan.score(t.frame, t.facts)))  # type: ignore[misc]
            self._session.judge(taken.shot, False, "a trial")
            self._show(taken.frame, Advice(True, ""))
            self._talk.hear(CurveSeen(scan.axis, tuple(places[: i + 1]), tuple(scores)))
        if places:
            advice = scan.choose(places, scores)
            self._talk.learn_noted(advice.facts)
            self._talk.doing(advice.say, lasts=True)
            self._set(scan, here + advice.moves.get(scan.axis, 0.0), here)

    def _here(self, axis: str) -> float:
        """Where the axis is; 0 for one that is set by hand."""
        return float(self._talk.facts.get(AT + axis, 0.0)) if axis in self._rig.axes() else 0.0

    def _set(self, scan: Scan, place: float, here: float) -> None:
        """Bring the axis to a place: by the bench, or by hand from where it is."""
        if scan.axis in self._rig.axes():
            self._go_to({scan.axis: place})
        elif place != here:
            self._by_hand(Advice(False, scan.say(place - here), by_hand={scan.axis: place - here}))

    # --- shots that count

    def shoot(self, shoot: Shoot) -> None:
        """Shots until they are enough; those that an interrupted run took are looked at first. Raises Stopped."""
        results: list[Outcomes] = []
        self._progress = LookProgress()
        for shot in self._earlier(shoot.purpose):
            self._judge(shoot, self._read_again(shot), results)
        for _ in range(shoot.most):
            if results and self._enough(shoot, results):
                return
            shake = shoot.shake(self._talk.facts)
            taken = self._exposer.take(shoot.purpose, self.step, moving=shoot.record_motion, shake=shake)
            self._judge(shoot, taken, results)
        if not (results and self._enough(shoot, results)):
            self._talk.doing(f"{shoot.most} shots were taken: going on with those that count", lasts=True)

    def _earlier(self, purpose: str) -> list[SessionShot]:
        """The shots of this step and purpose that count, or were not judged before the interruption."""
        shots = self._session.state.shots
        return [s for s in shots if (s.step, s.purpose) == (self.step, purpose) and s.counts is not False]

    def _read_again(self, shot: SessionShot) -> Taken:
        """A photograph that an interrupted run took."""
        frame = self._talk.attempt(lambda: read_frame(self._session.original(shot)))
        return Taken(shot, frame, {**self._talk.facts, **shot_facts(shot)})

    def _enough(self, shoot: Shoot, results: list[Outcomes]) -> bool:
        advice = shoot.enough(results, self._talk.facts)
        self._talk.learn_noted(advice.facts)
        if advice.doubted:
            resolve(self._talk, self.asks, advice.say, advice.doubted, last=self._progress.doubted())
            return False
        self._talk.doing(advice.say, len(results), shoot.most, lasts=True)
        return advice.good

    def _judge(self, shoot: Shoot, taken: Taken, results: list[Outcomes]) -> None:
        """Whether the shot counts, and why not; what it gives is added to the results."""
        advice = self._talk.attempt(lambda: shoot.check(taken.frame, taken.facts))
        if advice.good:
            self._talk.hear(Doing(f"estimating from shot {taken.shot.number}"))
            with same_bits():  # as the result is computed, which is made of the same estimates
                found = self._talk.attempt(lambda: shoot.estimate(taken.frame, taken.facts, results, self._known))
            refused = [one for one in found.values() if one.verdict is Verdict.REFUSED]
            if len(refused) < len(found):
                results.append(found)
            else:
                advice = Advice(False, f"{refused[0].reason}: {refused[0].remedy}")
        way = self._keep(taken, advice)
        if advice.doubted:
            resolve(self._talk, self.asks, advice.say, advice.doubted, last=self._progress.doubted())
        else:
            self._follow(way)

    def _keep(self, taken: Taken, advice: Advice) -> Way:
        """Whether the shot counts, for the session and the operator; how the advice is to be followed."""
        if advice.good:
            self._talk.learn_noted(advice.facts)
        self._session.judge(taken.shot, advice.good, "" if advice.good else advice.say)
        way = self._way(advice, taken.frame)
        self._show(taken.frame, way.told)
        return way

    # --- one shot at each of several places

    def tour(self, tour: Tour, go: Callable[[Go], None]) -> None:
        """A shot that counts at each place where none was taken yet; `go` moves there. Raises Stopped."""
        stops = tour.stops(self._talk.facts)
        for number, stop in enumerate(stops, 1):
            if self._visited(stop):
                continue
            self._talk.doing(stop.name, number, len(stops))
            reason = self._visit(stop, tour.tries, go)
            if reason:
                self._session.note("left_out", step=self.step, place=stop.name, reason=reason)
                self._talk.hear(Doing(f"{stop.name} is left out: {reason}", lasts=True))

    def _visited(self, stop: TourStop) -> bool:
        """Whether a shot of this place counts; one that was not judged before an interruption is judged now."""
        for shot in self._earlier(stop.name):
            if shot.counts is None:
                taken = self._read_again(shot)
                self._keep(taken, self._checked(stop, taken))
        return any(shot.counts for shot in self._earlier(stop.name))

    def _checked(self, stop: TourStop, taken: Taken) -> Advice:
        return self._talk.attempt(lambda: stop.check(taken.frame, taken.facts))

    def _visit(self, stop: TourStop, tries: int, go: Callable[[Go], None]) -> str:
        """Go there and try until a shot counts: "", or why the place is left out."""
        try:
            go(stop.go)
            while True:
                for _ in range(tries):
                    taken = self._exposer.take(stop.name, self.step)
                    advice = self._checked(stop, taken)
                    way = self._keep(taken, advice)
                    if advice.good:
                        return ""
                    self._follow(way)
                if not self._goes_on_trying(stop, tries):
                    return advice.say
        except Skipped:
            self._rig.leave_out_lost()
            return "the operator skipped it"

    def _goes_on_trying(self, stop: TourStop, tries: int) -> bool:
        """What the operator decides about a place where no shot counts. Raises Stopped."""
        question = f"{stop.name}: {tries} shots do not count. Leave this place out, or try again?"
        answer = self._talk.choose("place", question, (LEAVE_OUT, AGAIN, STOP))
        if answer == STOP:
            raise Stopped
        return answer == AGAIN
