"""Help on the open question: why it is asked, which answers are valid, and what the present step is."""

from collections.abc import Mapping

from procedures.plan import Ask, Step
from station.guide.answers import plain, words
from station.guide.frontend import BY_HAND, LAMP, MOVE

WHY: Mapping[str, str] = {
    MOVE: "Nothing moves before you agree. F12 stops every axis at any time; a stage that was stopped homes again.",
    LAMP: "The lamp may be bright enough to hurt at close range. It goes out when the run ends.",
    BY_HAND: "No axis of the bench can make this change. Where the camera sends a live picture, the question is "
    "answered as soon as the pose was held for three seconds.",
    "trouble": "Trying again is safe: every photograph taken so far is stored. Skipping leaves this action out.",
    "look": "The check still fails after several corrections. Going on unchanged may make the result doubtful.",
    "contradiction": "Two answers cannot both be true: sizes, distances and the lens are linked by geometry.",
    "verdict": "The numbers above are what you accept. Taking the shots again keeps the present ones in the session.",
    "place": "The result can do without this place if the others cover the frame.",
    "photographed": "The file is recognised as soon as it is complete in the folder.",
    "frames_folder": "Only photographs that arrive there from now on are used.",
    "paper": "The chart is drawn for the printable area of this paper.",
    "chart_width_mm": "A wider chart is photographed from farther away, where the lens is used; it needs more paper.",
    "chart_seed": "The number names the pattern of black and white cells, with which the photograph is compared.",
    "printed": "A printer that scales the page changes every distance. Matt paper has no glare.",
    "joined": "Cells that are shifted at a seam count as an error of the lens.",
    "ruler_mm": "Printers scale by up to a few per cent. The measured length corrects the size of the cells.",
    "mounted": "A bent chart is in focus in a part of its area only.",
    "lit": "The estimate needs even light; a gradient of a fifth is tolerated.",
    "camera_set": "Processing in the camera changes sharpness and tone: only RAW files show what the lens does.",
    "focused": "Autofocus between photographs would change the lens during the measurement.",
    "focal_length_mm": "With the pixel pitch it turns the size of the chart in the photograph into a distance.",
    "pixel_pitch_um": "The width of the sensor divided by its number of columns; it is in the data sheet.",
    "sensor_kind": "A colour mosaic has a plane for every colour, with twice the pixel pitch of the sensor.",
    "tape_mm": "It checks the distance that follows from the size of the chart; a centimetre is accurate enough.",
    "typed_f_number": "It gives the diffraction limit, with which the result is compared.",
    **dict.fromkeys(("refocused", "refocused_near"), "The sharpest focus depends on the distance, which has changed."),
    "focus_by": "A bracket of five photographs finds the sharpest focus better than the eye.",
    "apertures": "One photograph is taken at each. The lens is sharpest between its aberrations and diffraction.",
    "wanted_mtf50": "Shots are taken until their mean is as certain as this: half of it needs four times as many.",
    "places": "More places show more detail over the frame; each needs a photograph.",
    "views": "Each view is placed where it reduces the uncertainty of the camera most. Twelve are usually enough.",
    "aim": "The next views are chosen to make the direction of this pixel certain.",
    "wall": "The photographs are compared with each other, so the wall needs detail that a lens can blur.",
    "square": "A wall at an angle is in focus along a line only.",
    "tripod": "Both photographs must show the same part of the wall.",
    "near_mm": "The near photograph serves as the sharp one, since its detail is larger in the frame.",
    "ratio": "A larger ratio makes the near photograph sharper relative to the far one, but covers less of the wall.",
    "farther": "More distances make the result more certain, and show whether it holds at each of them.",
    **dict.fromkeys(("focused_near", "focused_far"), "Each distance needs its own focus."),
    "light": "A panel gives the sensor's noise and the vignetting in the same session.",
    "panel": "Close to the lens the panel is evenly bright over the whole frame.",
    "covered": "Dark pictures show offset and noise without light.",
    "uncovered": "The next pictures need light again.",
    **dict.fromkeys(
        ("panel_turned_1", "panel_turned_2", "panel_turned_3"),
        "Turning the panel separates its unevenness from the vignetting of the lens.",
    ),
    "screw_count": "The turns are computed for every screw that holds the sensor.",
    "screw_radius_mm": "The farther a screw is from the centre, the smaller the tilt that a turn makes.",
    "screw_pitch_mm": "The pitch of the thread: M2 has 0.4 mm, M3 0.5 mm.",
    "first_screw_deg": "The drawing shows the angles as on the face of a clock: 0 at 12 o'clock, 90 at 3, 180 at 6.",
    "blur_by": "Two photographs with different known blurs determine both the sharp picture and the depth.",
    "photographs": "A third blur makes the picture better where the first two lose the same detail.",
    "colour": "In colour every plane is restored with the same depth, which takes about four times as long.",
    "ground_truth": "A sharp photograph of the same scene shows the error of the restoration.",
    "motion_shape": "A recorded or measured motion is more reliable than one that is searched for.",
    "scene": "Whatever moves between the photographs is restored wrongly.",
    "max_w": "A larger limit takes longer; a smaller one cuts the blur of near objects.",
    **dict.fromkeys(
        ("first_f_number", "second_f_number", "third_f_number"), "The ratio of the f-numbers is the ratio of the blurs."
    ),
    "lens_f_number": "It gives the size of the defocus that is added to the motions.",
    "focus_m": "The depth in metres follows from the plane of focus.",
    "shape": "The shape of the aperture is the shape of the blur of a point out of focus.",
    "steady": "A uniform motion has a simple shape, which is fitted instead of searched for.",
    "region": "A flat part without depth shows the motion alone.",
    "first": "The exposure is set with the rig at rest.",
    **dict.fromkeys(("first_moves", "second", "third"), "Different motions lose different detail of the scene."),
    "truth": "The comparison needs the same scene from the same place.",
}


def explain(ask: Ask, step: Step | None) -> list[str]:
    """The question with its reason, the valid answers, and the step."""
    lines = [ask.question]
    lines += [WHY[ask.key]] if ask.key in WHY else []
    lines += [f"Answer: {_valid(ask)}."]
    if ask.default not in (None, "") and ask.kind != "confirm":
        lines.append(f"Enter accepts {words(ask.default, ask.unit)}.")
    if step is not None:
        lines.append(f"Step {step.title}: {step.instruction}")
    return lines


def _valid(ask: Ask) -> str:
    match ask.kind:
        case "confirm":
            return "Enter when it is done"
        case "choice":
            return f"one of {', '.join(ask.choices)}"
        case "text":
            return "a line of text"
    unit = f" in {ask.unit}" if ask.unit else ""
    low, high = (None if end is None else plain(end) for end in (ask.low, ask.high))
    match low, high:
        case None, None:
            return f"a number{unit}"
        case None, _:
            return f"a number{unit}, at most {high}"
        case _, None:
            return f"a number{unit}, at least {low}"
    return f"a number{unit}, from {low} to {high}"
