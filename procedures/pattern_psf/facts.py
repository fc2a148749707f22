"""Facts of a calibration with the chart: print, lens, sensor, observations, and quantities derived from them."""

from dataclasses import dataclass
from functools import lru_cache

from procedures.choice import START_K, START_S
from procedures.pattern import AIM_S_OVER_T, BEST_S_OVER_T, DEFAULT_SEED, Chart
from procedures.pattern_print.distance import LENGTH_MM, PHOTOSITES_PER_PIXEL
from procedures.pattern_print.sheet import ISO_PAPERS, Paper, Size, largest_width_mm, paper_named
from procedures.pattern_psf.corruptions import PRINTED_DOTS
from procedures.pattern_psf.estimate import PatternParameters
from procedures.pattern_psf.pose import ImagingGeometry
from procedures.plan import CameraFacts, Facts, derived_from, gathered, number, required
from procedures.quality import CAMERA, OPERATOR, WAVELENGTHS_NM, Diffraction
from procedures.raw import Plane

RATIO, (RATIO_LOW, RATIO_HIGH) = AIM_S_OVER_T, BEST_S_OVER_T
"""Target and tolerance of s/t. At 1 a cell is as wide as a sample of the PSF. For a lens sharper than the pixels, the
same number of shots has half the error at 1.3 (simulated: 24 mm at f/5.6 on pixels of 11.9 um)."""
SIZES = ("focal_length_mm", "pixel_pitch_um", "chart_width_mm", "ruler_mm")
"""Facts that relate the chart's size in the image to its distance."""
DOT_MM = 25.4 / 600  # dot of an office printer
LOOKS = "range_"
MOSAIC, MONOCHROME = SENSORS = ("mosaic", "monochrome")


@dataclass(frozen=True)
class RangeLook:
    """Apparent size of the chart, with the readings of laser and rail; None where there is none."""

    px_per_cell: float
    laser_mm: float | None = None
    rail_mm: float | None = None


def looks_of(facts: Facts) -> tuple[RangeLook, ...]:
    """Observations of the chart's size, in order. Raises BadParameter."""
    count = int(number(facts, f"{LOOKS}looks")) if f"{LOOKS}looks" in facts else 0
    return tuple(_look(facts, f"{LOOKS}{i}_") for i in range(1, count + 1))


def _look(facts: Facts, start: str) -> RangeLook:
    laser_mm, rail_mm = (
        number(facts, name) if (name := f"{start}{what}_mm") in facts else None for what in ("laser", "rail")
    )
    return RangeLook(number(facts, f"{start}cell_px"), laser_mm, rail_mm)


@lru_cache(maxsize=4)
def chart_of(seed: int) -> Chart:
    """Chart of a seed."""
    return Chart.from_seed(seed)


@dataclass(frozen=True)
class PatternFacts(CameraFacts):
    """Facts of the plan with the chart.

    paper : paper in the printer; None in sessions of earlier versions, which did not ask
    chart_width_mm : width of the print; None before it is chosen
    chart_seed : seed of the cells; the station's default if none was given
    seed_agreement : correlation of the observed cells with the seed's; None before the check
    ruler_mm : measured length of the printed ruler; None assumes a print at true size
    sensor_kind : one of `SENSORS`, from a photograph or as typed; a mosaic if not known
    s, k : sampling of the PSF; None for the automatic choice
    laser_offset_mm : distance of the rangefinder's zero behind the lens
    looks : observations of the chart's size
    focus_by : "ring", "rail" or "skip"
    white_percent, s_over_t, tilt_deg, focus_mtf50, mtf50_uncertainty : results of the steps: white in per cent of full
        scale, sampling ratio, larger of yaw and pitch, sharpness, and its standard uncertainty
    wanted_mtf50 : target standard uncertainty, in cycles/pixel
    tape_mm : distance of the chart by tape measure, where there is neither laser nor rail
    typed_f_number : f-number typed by the operator, where the camera records none
    """

    paper: str | None = None
    chart_width_mm: float | None = None
    chart_seed: int = DEFAULT_SEED
    seed_agreement: float | None = derived_from("chart_seed")
    ruler_mm: float | None = None
    sensor_kind: str = MOSAIC
    s: int | None = None
    k: int | None = None
    laser_offset_mm: float | None = derived_from(*SIZES)
    looks: tuple[RangeLook, ...] = gathered(looks_of, "chart_width_mm", "tape_mm", prefix=LOOKS)
    focus_by: str = "ring"
    white_percent: float | None = None
    s_over_t: float | None = None
    tilt_deg: float | None = None
    focus_mtf50: float | None = None
    mtf50_uncertainty: float | None = None
    wanted_mtf50: float | None = None
    tape_mm: float | None = None
    typed_f_number: float | None = None

    @property
    def aperture(self) -> float | None:
        """F-number recorded by the camera, else the typed one; None where neither is known."""
        return self.typed_f_number if self.f_number is None else self.f_number

    def diffraction(self, plane: Plane) -> Diffraction | None:
        """Diffraction limit of the plane, where aperture and pixel pitch are known."""
        if self.aperture is None or self.pixel_pitch_um is None:
            return None
        by = OPERATOR if self.f_number is None else CAMERA
        return Diffraction(self.aperture, self.pixel_pitch_um * plane.pitch, WAVELENGTHS_NM[plane.name[0]], by)

    @property
    def chart(self) -> Chart:
        """The printed chart."""
        return chart_of(self.chart_seed)

    @property
    def size(self) -> Size:
        """Size of the print; the largest that fits the paper before one is chosen."""
        if self.chart_width_mm is None:
            return Size(largest_width_mm(self.printed_on or ISO_PAPERS[0]))
        return Size(self.chart_width_mm)

    @property
    def printed_on(self) -> Paper | None:
        """Paper in the printer. Raises BadParameter for an unknown name."""
        return None if self.paper is None else paper_named(self.paper)

    @property
    def cell_mm(self) -> float:
        """Side of a printed cell, corrected by the measured ruler. Raises BadParameter."""
        width = required(self.chart_width_mm, "the chart's width", "answer the step `print`")
        return Size(width).cell_mm * (LENGTH_MM if self.ruler_mm is None else self.ruler_mm) / LENGTH_MM

    @property
    def print_blur(self) -> float | None:
        """Standard deviation of the print's blur in cells, by the printer's dots; None before the print."""
        return None if self.chart_width_mm is None else PRINTED_DOTS * DOT_MM / self.cell_mm

    @property
    def parameters(self) -> PatternParameters:
        """Sampling of the PSF: given by the facts, else chosen automatically."""
        if self.s is None or self.k is None:
            return PatternParameters(print_blur=self.print_blur)
        return PatternParameters(self.s, self.k, chosen=True, print_blur=self.print_blur)

    @property
    def quick_parameters(self) -> PatternParameters:
        """Sampling of a PSF of which only the sharpness is used, many times over."""
        parameters = self.parameters
        return parameters if parameters.s is not None else PatternParameters(START_S, START_K, chosen=True)

    @property
    def lens_known(self) -> bool:
        """Whether distances can be computed from sizes."""
        return None not in (self.focal_length_mm, self.pixel_pitch_um, self.chart_width_mm)

    def optics(self, pitch: int | None = None) -> ImagingGeometry:
        """Relation of sizes and distances for planes of `pitch`, None: by the kind of sensor. Raises BadParameter."""
        remedy = "answer the step `distance`"
        pitch = pitch or (1 if self.sensor_kind == MONOCHROME else PHOTOSITES_PER_PIXEL)
        focal_length_mm = required(self.focal_length_mm, "the lens's focal length", remedy)
        pitch_um = required(self.pixel_pitch_um, "the sensor's pixel pitch", remedy)
        return ImagingGeometry(focal_length_mm, pitch_um * pitch, self.cell_mm)

    @property
    def wanted_px_per_cell(self) -> float:
        """Pixels of the plane per cell at the target s/t."""
        return RATIO / self.s_or_start

    @property
    def s_or_start(self) -> int:
        """Samples per pixel: given, or the first trial of the choice."""
        return self.parameters.s or START_S

    def wanted_distance_mm(self) -> float:
        """Target distance, by lens, sensor and print. Raises BadParameter."""
        return self.optics().distance_mm(self.wanted_px_per_cell)
