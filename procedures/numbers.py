"""Every number that a result can have: name, unit, label, definition, and where it is shown.

This is the only place where a number's name is written. Estimators name their results by the constants below; records,
tables, pages, terminals, limits, trends, certificates and the manual's reference are loops over `NUMBERS`.
"""

import re
from collections.abc import Iterable, Mapping
from enum import StrEnum
from itertools import product

LEVELS = (50, 30, 20, 10)  # contrast levels, in per cent, whose frequencies are reported
CYCLES = "cycles/pixel"
MEDIAN = "_median"  # ends the name of a number that is the median of a map over the frame
_WITHOUT_PHOTOSITE = "_without_photosite"  # ends the name of a map's number after division by the photosite's MTF


class Group(StrEnum):
    """Where a number is shown, besides records and tables, which hold all of them."""

    HEADLINE = "headline"  # the first table of a page
    BUDGET = "budget"  # the uncertainty budget of a page
    SCREEN = "screen"  # the result on an 80-column terminal
    LINE = "line"  # the one line that a command prints for a plane
    CERTIFIED = "certified"  # the certificate
    TREND = "trend"  # the trend of a camera over its sessions
    SUMMARY = "summary"  # the summary of a batch
    MAP = "map"  # maps over the frame


class Number(str):
    """A number's name, which is a plain string wherever it is stored, with what it means.

    unit : "1" where it has none; "" where that depends on the photographs
    label : for pages; `short` for tables and terminals
    symbol : as standards and papers write it
    definition : one sentence for the manual
    groups : where it is shown
    section : heading of the manual's reference
    """

    unit: str
    label: str
    short: str
    symbol: str
    definition: str
    groups: frozenset[Group]
    section: str

    def __reduce__(self) -> tuple[type[str], tuple[str]]:
        """Copies, and what other processes receive, are plain strings: equal, and they find the number again."""
        return str, (str(self),)


NUMBERS: dict[str, Number] = {}  # all numbers by name, in the order in which they are shown


class NumberSection:
    """Registers the numbers of one section of the manual's reference: called with a name, unit, label, definition."""

    def __init__(self, title: str) -> None:
        self.title = title

    def __call__(
        self, name: str, unit: str, label: str, definition: str, *groups: Group, short: str = "", symbol: str = ""
    ) -> Number:
        """The number, which is in the table from now on."""
        number = Number(name)
        number.unit, number.label, number.short, number.symbol = unit, label, short or label, symbol
        number.definition, number.groups, number.section = definition, frozenset(groups), self.title
        return NUMBERS.setdefault(name, number)


_H, _B, _S, _L, _C, _T, _U, _M = Group
HORIZONTAL, VERTICAL, RADIAL = "horizontal", "vertical", "radial"
DIRECTIONS: Mapping[str, tuple[str, str]] = {
    HORIZONTAL: ("along rows", "rows"),
    VERTICAL: ("along columns", "columns"),
    RADIAL: ("mean over directions", "mean"),
    "sagittal": ("of sagittal detail", "sagittal"),
    "meridional": ("of meridional detail", "meridional"),
}
"""Directions of an MTF: the words of a page, and of a narrow table."""

# --- of a PSF --------------------------------------------------------------------------------------------------------

_psf = NumberSection("Of a PSF")


def _crossing(level: int, direction: str) -> Number:
    words, short = DIRECTIONS[direction]
    mean = direction == RADIAL
    groups = () if mean or level not in (50, 20) else (_C,) if level == 20 else (_H, _B, _S, _L, _C, _T, _U)
    return _psf(
        f"mtf{level}_{direction}", CYCLES, f"MTF{level}{',' if mean else ''} {words}",
        f"the first frequency f at which MTF(f) = {level / 100:g}", *groups,
        short=f"MTF{level}" if mean else f"MTF{level}, {short}", symbol=f"f{level}",
    )  # fmt: skip


MTF_CROSSINGS: Mapping[tuple[int, str], Number] = {
    at: _crossing(*at) for at in product(LEVELS, (HORIZONTAL, VERTICAL, RADIAL))
}
"""By level in per cent and direction."""
MTF50_HORIZONTAL, MTF50_VERTICAL, MTF50_RADIAL = (MTF_CROSSINGS[50, one] for one in (HORIZONTAL, VERTICAL, RADIAL))
_AT_NYQUIST = "MTF(1/2)"
MTF_NYQUIST: Mapping[str, Number] = {
    HORIZONTAL: _psf("mtf_nyquist_horizontal", "1", "MTF at Nyquist along rows", _AT_NYQUIST, _B, _C,
                     short="at Nyquist, rows"),
    VERTICAL: _psf("mtf_nyquist_vertical", "1", "MTF at Nyquist along columns", _AT_NYQUIST, _B, _C,
                   short="at Nyquist, columns"),
    RADIAL: _psf("mtf_nyquist_radial", "1", "MTF at Nyquist", _AT_NYQUIST, _H, _S),
}  # fmt: skip
"""By direction."""
ENERGY_ABOVE_NYQUIST = _psf(
    "energy_above_nyquist", "1", "Energy above Nyquist",
    "1 - ∫∫ OTF² over abs(fx), abs(fy) ≤ 1/2, over that of all frequencies; the contribution of noise is subtracted",
    _H, _B, _U, _M, short="above Nyquist",
)  # fmt: skip
_FWHM = "full width at half maximum of the section through the centre"
FWHM_HORIZONTAL = _psf("fwhm_horizontal", "pixel", "Half maximum along rows", _FWHM, _H, _B, _S, _C, short="FWHM, rows")
FWHM_VERTICAL = _psf(
    "fwhm_vertical", "pixel", "Half maximum along columns", _FWHM, _H, _B, _S, _C, short="FWHM, columns"
)
_EE = "radius about the centre that encloses {} % of all light"
ENCIRCLED_ENERGY_50 = _psf(
    "encircled_energy_50", "pixel", "Radius of 50 % energy", _EE.format(50), short="50 % energy in", symbol="EE50"
)
ENCIRCLED_ENERGY_80 = _psf(
    "encircled_energy_80", "pixel", "Radius of 80 % energy", _EE.format(80), _H, _B, _S, _C,
    short="80 % energy in", symbol="EE80",
)  # fmt: skip
ELLIPTICITY = _psf(
    "ellipticity", "1", "Ellipticity", "1 - b/a of the second moments under a Gaussian weight as wide as the core", _H
)
ELLIPSE_ANGLE = _psf(
    "ellipse_angle", "degree", "Direction of the long axis", "direction of the major axis a, from x towards y"
)
_FIRST_MOMENT = "first moment of the samples inside the support, from the PSF's centre"
CENTROID_X = _psf("centroid_x_support", "pixel", "Centroid x, of the support", _FIRST_MOMENT, _H)
CENTROID_Y = _psf("centroid_y_support", "pixel", "Centroid y, of the support", _FIRST_MOMENT, _H)
STREHL = _psf(
    "strehl", "1", "Strehl ratio with photosite",
    "value at the centre over that of diffraction alone (f-number, pitch, wavelength), in the band of s; it includes "
    "photosite and low-pass filter, so it is the camera's", _H, _B, _S, _C, short="Strehl ratio", symbol="S",
)  # fmt: skip
GAUSSIAN_RADIUS = _psf(
    "gaussian_radius", "sensor pixel", "Gaussian radius for RAW developers",
    "sigma = sqrt(ln 2 / 2) / (π f) of the Gaussian with the same radial MTF50 f; the radius of capture sharpening in "
    "RAW developers", _H,
)  # fmt: skip
ENERGY_OUTSIDE_SUPPORT = _psf(
    "energy_outside_support", "1", "Energy outside the support of the samples",
    "share of all light outside the k x k samples", _M, short="energy outside",
)  # fmt: skip

# --- of the estimate -------------------------------------------------------------------------------------------------

_estimate = NumberSection("Of the estimate")
SAMPLES_PER_PIXEL = _estimate("s", "1", "Samples per pixel", "samples per pixel of the plane")
SUPPORT = _estimate("k", "1", "Samples of the support", "samples along one side of the support")
S_OVER_T = _estimate(
    "s_over_t", "1", "Sampling ratio s/t",
    "sampling ratio: s times the width of a cell in pixels ([why](../explanation/sampling-and-gamma.md))",
)  # fmt: skip
GAMMA = _estimate(
    "gamma", "1", "Noise amplification γ = Σ 1/σᵢ² of this view",
    "noise amplification of the photograph, the trace of (AᵀA)⁻¹ = Σ 1/σᵢ², A the chart as seen, black 0 and white 1",
    symbol="γ",
)  # fmt: skip
GAMMA_BOUND = _estimate(
    "gamma_bound", "1", "The least γ that any chart could have",
    "the smallest that any chart with m samples and n PSF values could have: (1 + 4 (n - 1)²) / (m n)",
)  # fmt: skip
RESIDUAL_STD = _estimate(
    "residual_std", "1", "Residual, in standard deviations of the noise",
    "residual of the fit over the noise measured next to it: 1 is right; of two photographs over the greatest residual "
    "that noise explains: up to 1 is right", _U, short="residual",
)  # fmt: skip
WITNESS_RATIO = _estimate(
    "witness_ratio", "1", "Signals over exposures",
    "ratio of two exposures' signals over that of their times: 1 of a linear camera", _L, _C,
)  # fmt: skip
WITNESS_CURVATURE = _estimate(
    "witness_curvature", "1", "Curvature of two exposures",
    "departure of one exposure's signals from a line through the other's, at the middle of the range, over the range",
    _L, _C,
)  # fmt: skip
WITNESS_SHARPENING = _estimate(
    "witness_sharpening", "1", "Unsharp mask by two exposures",
    "amount of the unsharp mask that the noise of two exposures' difference shows most clearly; negative: smoothing",
    _L, _C,
)  # fmt: skip
WITNESS_PRINT_BLUR = _estimate(
    "witness_print_blur", "1", "Blur of the print, squared cells",
    "variance of the print's blur in squared cells, by the MTF from two distances", _L, _C,
)  # fmt: skip
WITNESS_BLACK = _estimate(
    "witness_black", "1", "Change of black with the distance",
    "black over white from the distance less that from nearer: 0 without stray light", _L, _C,
)  # fmt: skip
PIXELS_PER_PATTERN = _estimate(
    "pixels_per_pattern", "pixel", "Width of the noise region",
    "width of the noise region in pixels of the plane",
)  # fmt: skip
SCALE = _estimate("scale", "1", "Zoom", "two photographs: zoom along x and y, far over near distance")
GAIN = _estimate(
    "gain", "1", "Contrast of the far photograph over the near one's",
    "two photographs: contrast of the far one over the near one's",
)  # fmt: skip
NOISE = _estimate(
    "noise", "1", "Noise, of the scale from black to white", "standard deviation of a pixel's noise, white = 1"
)

_STABLE = "the largest region of frequencies above one value of the MTF in which repeated PSFs agree to a limit"
SENSITIVITY = _estimate(
    "mtf_sensitivity", "1", "Relative sensitivity of the MTF",
    "mean over all frequencies of the MTF's standard deviation from result to result, over the mean of the MTF", _H, _L,
    symbol="s(Ω)",
)  # fmt: skip
SENSITIVITY_AT_5 = _estimate(
    "mtf_sensitivity_above_5_percent", "1", "Relative sensitivity where the MTF is 5 % or more",
    "relative sensitivity of the MTF over the frequencies at which it is 5 % or more", _H, _L,
)  # fmt: skip
STABLE_MTF = _estimate("stable_mtf", "1", "Least MTF of the stable domain", f"least MTF of {_STABLE}", _H)
STABLE_HORIZONTAL, STABLE_VERTICAL = (
    _estimate(f"stable_frequency_{way}", CYCLES, f"End of the stable domain {words}", f"end, {words}, of {_STABLE}", _H)
    for way, words in (("horizontal", "along rows"), ("vertical", "along columns"))
)

# --- across an edge --------------------------------------------------------------------------------------------------

_edge = NumberSection("Across an edge")
EDGE_CROSSINGS: Mapping[int, Number] = {
    level: _edge(
        f"mtf{level}", CYCLES, f"MTF{level} across the edge",
        f"the frequency along the edge's normal at which the MTF is {level / 100:g}",
        *((_H, _L, _C, _U, _T) if level == 50 else (_H, _C)), short=f"MTF{level}",
    )
    for level in LEVELS
}  # fmt: skip
"""By level in per cent."""
EDGE_MTF50 = EDGE_CROSSINGS[50]
EDGE_MTF_NYQUIST = _edge(
    "mtf_nyquist", "1", "MTF at Nyquist across the edge", "MTF at 1/2 cycle/pixel", _H, _C, _U, short="at Nyquist"
)
EDGE_ANGLE = _edge(
    "angle", "degree", "Angle of the edge", "between the edge and the nearest axis of the pixels", _H, short="angle"
)
PROBABILITY = _estimate(
    "probability_within_2", "1", "Probability that MTF50 lies within two stated uncertainties",
    "probability, by the statistics of all checks, that MTF50 (along rows) lies within two stated uncertainties, as "
    "calibrated on clean and damaged photographs ([how](../explanation/verdicts.md#how-probable-a-number-is))",
    _H, _L, _C, _U, short="P(within 2 u)",
)  # fmt: skip

# --- over the frame --------------------------------------------------------------------------------------------------

_frame = NumberSection("Over the frame")
MTF50_SAGITTAL = _frame(
    "mtf50_sagittal", CYCLES, "MTF50 of sagittal detail",
    "MTF50 of detail that repeats across the radius from the frame's centre", _M, short="MTF50, sagittal",
)  # fmt: skip
MTF50_MERIDIONAL = _frame(
    "mtf50_meridional", CYCLES, "MTF50 of meridional detail", "MTF50 of detail that repeats along the radius", _M,
    short="MTF50, meridional",
)  # fmt: skip
ASTIGMATISM = _frame(
    "astigmatism", CYCLES, "MTF50, sagittal less meridional", "sagittal less meridional MTF50", _M, short="astigmatism"
)
OF_PLACES = (MTF50_SAGITTAL, MTF50_MERIDIONAL, ASTIGMATISM)
"""Numbers that a place of a field has in addition to those of its PSF."""
for _one in OF_PLACES:
    _frame(
        f"{_one}{_WITHOUT_PHOTOSITE}", CYCLES, f"{_one.label}, without the photosite",
        "the same of the camera's MTF over that of a square photosite in the same direction", _M,
    )  # fmt: skip
for _one in (*OF_PLACES, ENERGY_ABOVE_NYQUIST, ENERGY_OUTSIDE_SUPPORT):
    _frame(
        f"{_one}{MEDIAN}", _one.unit, f"{_one.label}, median over the frame", "median of the map over the frame",
        *((_C,) if _one in OF_PLACES else ()),
    )  # fmt: skip
ERROR_NOISE = _frame("error_noise", "of the PSF's norm", "error from noise", "norm of the field's error from noise", _M)
ERROR_INTERPOLATION = _frame(
    "error_interpolation", "of the PSF's norm", "error from interpolation",
    "norm of the field's error from the model between the nodes", _M,
)  # fmt: skip
FOCUS: Mapping[str, Number] = {
    name: _frame(f"focus_{name}", "mm", label, f"with a focus bracket: {words}", _M)
    for name, label, words in (
        ("sagittal", "Best focus of sagittal detail", "best focus of sagittal detail"),
        ("meridional", "Best focus of meridional detail", "best focus of meridional detail"),
        ("mean", "Best focus, mean of both", "mean of both"),
        ("astigmatism", "Best focus, sagittal less meridional", "sagittal less meridional best focus"),
    )
}
"""Best focus over the frame, by what is focused on."""

# --- of a sensor (EMVA 1288) -----------------------------------------------------------------------------------------

_sensor = NumberSection("Of a sensor (EMVA 1288)")


QUANTUM_EFFICIENCY = _sensor(
    "quantum_efficiency", "1", "Quantum efficiency η", "responsivity over gain", _H, _C, symbol="η"
)
SYSTEM_GAIN = _sensor("system_gain", "DN/e-", "System gain K", "slope of the photon transfer curve", _H, _L, _C, _T, _U,
                    symbol="K")  # fmt: skip
SYSTEM_GAIN_AT_DARK = _sensor(
    "system_gain_at_dark", "DN/e-", "System gain K of small signals",
    "the same, corrected for the response's curvature", _H,
)  # fmt: skip
INVERSE_GAIN = _sensor("inverse_gain", "e-/DN", "Inverse gain 1/K", "electrons per digital number", symbol="1/K")
TEMPORAL_DARK_NOISE = _sensor(
    "temporal_dark_noise", "e-", "Temporal dark noise σ_d", "noise in the dark without rounding, in electrons",
    _H, _L, _C, _T, _U, symbol="σ_d",
)  # fmt: skip
TEMPORAL_DARK_NOISE_DN = _sensor(
    "temporal_dark_noise_dn", "DN", "Temporal dark noise", "noise in the dark, rounding included", _H
)
_THRESHOLD = "at which the signal equals its own noise"
SENSITIVITY_THRESHOLD = _sensor(
    "sensitivity_threshold", "e-", "Absolute sensitivity threshold", f"electrons {_THRESHOLD}", _H
)
SENSITIVITY_THRESHOLD_PHOTONS = _sensor(
    "sensitivity_threshold_photons", "photons", "Absolute sensitivity threshold", f"photons {_THRESHOLD}", _H, _C
)
RESPONSIVITY = _sensor("responsivity", "", "Responsivity", "slope of the characteristic curve", symbol="R")
SATURATION_CAPACITY = _sensor(
    "saturation_capacity", "e-", "Saturation capacity", "electrons at the largest temporal variance", _H, _L, _C, _U
)
SATURATION_PHOTONS = _sensor("saturation_photons", "photons", "Light at saturation", "photons at saturation", _H, _C)
SATURATION_SIGNAL = _sensor("saturation_signal", "DN", "Signal at saturation", "signal at saturation", _H)
SNR_MAX = _sensor("snr_max", "1", "Largest SNR", "root of the saturation capacity", _H, _C)
SNR_MAX_DB = _sensor("snr_max_db", "dB", "Largest SNR", "the same in decibels", _H)
DYNAMIC_RANGE = _sensor("dynamic_range", "1", "Dynamic range", "saturation capacity over sensitivity threshold", _H, _C)
DYNAMIC_RANGE_DB = _sensor("dynamic_range_db", "dB", "Dynamic range", "the same in decibels", _H, _L, _U)
LINEARITY_ERROR = _sensor(
    "linearity_error", "%", "Linearity error", "mean absolute deviation from the line, 5 to 95 % of saturation",
    _H, _L, _C, _U,
)  # fmt: skip
LINEARITY_ERROR_MIN = _sensor("linearity_error_min", "%", "Lowest deviation", "lowest deviation from the line", _H)
LINEARITY_ERROR_MAX = _sensor("linearity_error_max", "%", "Highest deviation", "highest deviation from the line", _H)
DARK_CURRENT = _sensor(
    "dark_current", "e-/s", "Dark current, by mean", "slope of the dark signal over exposure time", _H, _C
)
DARK_CURRENT_BY_VARIANCE = _sensor(
    "dark_current_by_variance", "e-/s", "Dark current, by variance", "slope of the dark variance over exposure time", _H
)
GENERAL_SNR_MAX = _sensor("general_snr_max", "1", "General model: largest SNR", "largest measured SNR of the light", _H)
GENERAL_THRESHOLD = _sensor("general_threshold", "", "General model: threshold", f"light {_THRESHOLD}", _H)
GENERAL_DYNAMIC_RANGE = _sensor(
    "general_dynamic_range", "1", "General model: dynamic range", "light at saturation over the threshold", _H
)
PARTS = ("", "_row", "_column", "_pixel")
"""Suffixes of a non-uniformity: all pixels, and its parts by row, by column, by pixel."""
_OF_PART = {"": "", "_row": " of rows", "_column": " of columns", "_pixel": " of pixels"}
WITHOUT_DEFECTS, HIGHPASS = "_without_defects", "_highpass"
_SUFFIXES = {"": ("", ""), WITHOUT_DEFECTS: (", defects excluded", ", defect pixels excluded"),
             HIGHPASS: (", uneven light removed", ", after a high-pass filter")}  # fmt: skip


def _uniformity(quantity: str, unit: str, unit_suffix: str, words: str, suffixes: Iterable[str]) -> None:
    for suffix, part in product(suffixes, PARTS):
        label, addition = _SUFFIXES[suffix]
        plain, whole = not suffix and not unit_suffix, not part
        groups = [_H] if not unit_suffix and (whole or plain) else []
        groups += [_L, _C, _T, _U] if plain and whole else []
        _sensor(f"{quantity}{part}{suffix}{unit_suffix}", unit, f"{quantity.upper()}{_OF_PART[part]}{label}",
              f"{words}{_OF_PART[part]}{addition}", *groups)  # fmt: skip


_uniformity("dsnu", "e-", "", "standard deviation of the mean dark picture", ("", WITHOUT_DEFECTS))
_uniformity("dsnu", "DN", "_dn", "standard deviation of the mean dark picture", ("", WITHOUT_DEFECTS))
_uniformity("prnu", "%", "", "standard deviation of the response", ("", WITHOUT_DEFECTS, HIGHPASS))


def non_uniformity(quantity: str, part: str = "", suffix: str = "", unit_suffix: str = "") -> Number:
    """DSNU or PRNU of a part. Raises KeyError where there is no such number."""
    return NUMBERS[f"{quantity}{part}{suffix}{unit_suffix}"]


DSNU, PRNU = NUMBERS["dsnu"], NUMBERS["prnu"]
DEFECT_PIXELS: Mapping[str, Number] = {
    "dark": _sensor(
        "defect_pixels_dark", "pixels", "Defect pixels in the dark", "pixels beyond the defect limit", _H, _C
    ),
    "light": _sensor(
        "defect_pixels_light", "pixels", "Defect pixels in even light", "pixels beyond the defect limit", _H, _C
    ),
}
"""By picture."""

# --- of flats --------------------------------------------------------------------------------------------------------

_flats = NumberSection("Of flats")
_LIGHT = "light in the frame's corners over that at its centre: "
CORNER_LIGHT = _flats("corner_light", "1", "Light in the corners", f"{_LIGHT}their mean", _H, _L, _C, _T, _U)
DARKEST_CORNER = _flats("darkest_corner", "1", "Light in the darkest corner", f"{_LIGHT}the least", _H, _L, _C, _U)
_RADIAL_CENTRE = "centre of the radial formula from the frame's, in pixels of the plane"
VIGNETTING_CENTRE_X = _flats("vignetting_centre_x", "pixel", "Centre of the vignetting, x", _RADIAL_CENTRE, _H, _L)
VIGNETTING_CENTRE_Y = _flats("vignetting_centre_y", "pixel", "Centre of the vignetting, y", _RADIAL_CENTRE, _H, _L)
VIGNETTING_K = tuple(
    _flats(f"vignetting_k{power}", "1", f"Radial coefficient k{power}",
           f"coefficient of r^{2 * power} in 1 + k1 r² + k2 r⁴ + k3 r⁶, r = 1 at half the diagonal", _H)
    for power in (1, 2, 3)
)  # fmt: skip
"""Coefficients of the radial formula, of rising power."""
VIGNETTING_NOT_RADIAL = _flats(
    "vignetting_not_radial", "1", "Not radial", "rms over the frame of the formula's relative error", _H
)
COLOUR_SHADING = _flats(
    "colour_shading", "1", "Colour shading", "rms over the frame of the light over that of green, less 1", _H, _L, _C
)

# --- of the sensor's plane -------------------------------------------------------------------------------------------

_tilt = NumberSection("Of the sensor's plane")
_EDGES = "height of the sensor behind best focus at the photograph's {} edge over that at its {}"
TILT_HORIZONTAL = _tilt("tilt_horizontal", "um", "Tilt, horizontal", _EDGES.format("right", "left"), _H, _L, _C, _T, _U)
TILT_VERTICAL = _tilt("tilt_vertical", "um", "Tilt, vertical", _EDGES.format("lower", "upper"), _H, _L, _C, _T, _U)
BACKFOCUS = _tilt("backfocus", "um", "Backfocus", "mean height over the frame at the nominal position", _H, _L, _C, _U)
SHIM = _tilt(
    "shim", "um", "Shim", "change of thickness of a shim under the lens's mount that makes the mean height 0: "
    "less `backfocus`", _H, _L,
)  # fmt: skip
BACKFOCUS_CENTRE = _tilt(
    "backfocus_centre", "um", "Backfocus at the centre",
    "height of the smooth surface at the frame's centre, at the nominal position", _H, _L,
)  # fmt: skip
TILT_CORNER = _tilt(
    "tilt_corner", "um", "Tilt at the highest corner", "height of the highest corner over the centre", _H, _L, _C, _U
)
FIELD_CURVATURE = _tilt(
    "field_curvature", "um", "Field curvature", "mean quadratic of the heights, at half the diagonal", _H, _L, _C
)
RMS_BEFORE = _tilt("rms_before", "um", "Rms before the turns", "rms height of the plane over the frame", _H, _L)
RMS_AFTER = _tilt("rms_after", "um", "Rms after the turns", "the same as expected after the turns", _H, _L)
HELPS = _tilt("helps", "1", "Probability of help", "probability that the turns bring the plane nearer to best focus")

# --- of a camera's geometry ------------------------------------------------------------------------------------------

_geometry = NumberSection("Of a camera's geometry")
_FOCAL = "focal length in pixels of the sensor"
FOCAL = tuple(
    _geometry(name, "pixel", f"Focal length {name}", _FOCAL, _H, _L, _C, _T, _U, short=name, symbol=name)
    for name in ("f", "fx", "fy")
)
"""Focal lengths of both axes in one, along x and along y: a model has the first, or the others."""
PRINCIPAL_POINT = tuple(
    _geometry(name, "pixel", f"Principal point {name}", "principal point, pixel centres at integers", _H, _L, _C, _T,
              short=name, symbol=name)
    for name in ("cx", "cy")
)  # fmt: skip
for _one_name in (*(f"k{i}" for i in range(9)), *(f"p{i}" for i in range(3)), *(f"s{i}" for i in range(5)),
                  "sx1", "sy1", "omega", "alpha", "beta", "xi"):  # fmt: skip
    _geometry(
        _one_name, "1", f"Distortion {_one_name}", "coefficient of the camera model's distortion", _C, short=_one_name
    )
_PROJECTION = "projection_uncertainty_"
_CHART_TERMS = (
    "stretch", "shear", *(f"uneven_{a}_{b}" for a in "xy" for b in ("xx", "xy", "yy")),
    *(f"bend_{b}" for b in ("xx", "xy", "yy", "xxx", "xxy", "xyy", "yyy")),
)  # fmt: skip
for _one_name in _CHART_TERMS:
    _geometry(_one_name, "mm", f"Chart: {_one_name.replace('_', ' ')}", "departure of the printed chart at its rim")
ROW_TIME = _geometry("row_time", "us", "Row time", "time between the exposures of neighbouring rows", _H, _C, _T, _U)
READOUT_TIME = _geometry(
    "readout_time", "ms", "Readout time", "time from the exposure of the first row to that of the last",
    _H, _L, _C, _T, _U,
)  # fmt: skip
BASELINE = _geometry(
    "baseline", "mm", "Baseline", "distance between the centres of a rig's two cameras", _H, _L, _C, _T, _U
)
TURN = _geometry("turn", "degree", "Turn", "angle between the axes of a rig's two cameras", _H, _L, _C, _T, _U)

# --- what a PSF is made of -------------------------------------------------------------------------------------------

_physics = NumberSection("What a PSF is made of (`--physics`)")
SIDE = _physics("side", "pixel", "Side of the photosite", "side of the photosite's aperture, in sensor pixels")
NOTCH = _physics("notch", "1", "Notch of the photosite", "part of the side that an L-shaped aperture lacks")
SEPARATION = _physics("separation", "pixel", "Low-pass filter", "distance of the low-pass filter's spots")
DIFFUSION = _physics("diffusion", "pixel", "Charge diffusion", "sigma of the charge's diffusion")
FILL_FACTOR = _physics("fill_factor", "1", "Fill factor", "area of the aperture over that of the pixel")
ABERRATIONS = tuple(
    _physics(name, "wave rms", label, "aberration, Noll's polynomials 4 to 11")
    for name, label in (
        ("defocus", "Defocus"), ("astigmatism", ""), ("astigmatism_oblique", "Oblique astigmatism"),
        ("coma_x", "Coma x"), ("coma_y", "Coma y"), ("trefoil_x", "Trefoil x"), ("trefoil_y", "Trefoil y"),
        ("spherical", "Spherical aberration"),
    )
)  # fmt: skip
WAVEFRONT_RMS = _physics(
    "wavefront_rms", "wave", "Wavefront error, rms", "root of the sum of the aberrations' squares", _U
)
WAVEFRONT_RMS_NM = _physics("wavefront_rms_nm", "nm", "Wavefront error, rms", "the same in nanometres")
STREHL_LENS = _physics("strehl_lens", "1", "Strehl ratio of the lens", "Strehl ratio of the lens alone")

# --- of a restoration ------------------------------------------------------------------------------------------------

_restoration = NumberSection("Of a restoration")
W_MEDIAN = _restoration("w_median", "pixel", "Blur w, median over the frame", "median of the blur map", _U, _L,
                        short="w, median")  # fmt: skip
W_LEAST = _restoration("w_least", "pixel", "Blur w, least of the frame", "least of the blur map", short="w, least")
W_GREATEST = _restoration(
    "w_greatest", "pixel", "Blur w, greatest of the frame", "greatest of the blur map", short="w, greatest"
)
DEPTH_OF_FIELD_NEAR = _restoration(
    "depth_of_field_near", "m", "Near limit of the depth of field", "distance whose blur circle is one pixel wide, in "
    "front of the plane of focus", _L, short="near limit",
)  # fmt: skip
DEPTH_OF_FIELD_FAR = _restoration(
    "depth_of_field_far", "m", "Far limit of the depth of field", "distance whose blur circle is one pixel wide, "
    "behind the plane of focus", _L, short="far limit",
)  # fmt: skip
PICTURE_STD = _restoration(
    "picture_std", "1", "Expected error of the picture",
    "expected root mean square error of the restored picture, white = 1", _L, _U, short="expected error",
)  # fmt: skip
RESIDUAL_OVER_NOISE = _restoration(
    "residual_over_noise", "1", "Residual, over the noise",
    "residual over the photographs' own noise: of their finest detail, or of the residual where the scene is smooth, "
    "whichever is greater", _U, short="residual / noise",
)  # fmt: skip
UNDETERMINED = _restoration(
    "undetermined", "1", "Share of the frame without a reliable depth",
    "part of the frame whose depth is uncertain by more than half a pixel", _U, short="no reliable depth",
)  # fmt: skip

# --- of a corrected photograph ---------------------------------------------------------------------------------------

_correction = NumberSection("Of a corrected photograph")
MTF50_BEFORE = _correction(
    "mtf50_before", CYCLES, "MTF50 of the photograph", "MTF50 of the lens's field, mean over directions, median over "
    "the frame", _H, short="MTF50 before",
)  # fmt: skip
MTF50_AFTER = _correction(
    "mtf50_after", CYCLES, "Predicted MTF50 of the picture", "the same after the correction, as predicted",
    _H, _L, _C, _U, short="MTF50 after",
)  # fmt: skip
NOISE_GAIN = _correction(
    "noise_gain", "1", "Noise of the picture over the photograph's", "predicted standard deviation of the noise where "
    "the scene is flat, after over before, median over the frame", _H, _L, _C, _U, short="noise gain",
)  # fmt: skip
FIELD_ERROR = _correction(
    "field_error", "1", "Error from the field", "rms error of the picture from the uncertainty of the field, white = 1",
    _H, _C, short="field error",
)  # fmt: skip
CURVE_ERROR = _correction(
    "curve_error", "1", "Error from the tone curve", "rms error of a developed picture's light from its unknown tone "
    "curve, white = 1", _H, _C, short="curve error",
)  # fmt: skip

# --- of a filtered render --------------------------------------------------------------------------------------------

_render = NumberSection("Of a filtered render")
SIMILAR_PATCHES = _render(
    "similar_patches", "1", "Similar patches per pixel", "median over the frame at the finest scale", _H, _L, _C, _U,
    short="similar patches",
)  # fmt: skip
SAMPLES_CAST = _render("mean_samples", "1", "Samples per pixel", "mean over the frame", _H, _C, short="samples")
DROPPED_SAMPLES = _render("dropped_samples", "1", "Dropped samples", "samples that were NaN or infinite", _H, _C, _U)
RENDER_UNCERTAINTY = _render(
    "render_uncertainty", "1", "Standard uncertainty of a value, median",
    "median over the frame of the picture's standard uncertainty, white = 1", _H, _L, _C, _U, short="uncertainty",
)  # fmt: skip
COVERAGE = _render(
    "coverage_2_sigma", "1", "Values within two standard uncertainties",
    "share of the values that lie within two standard uncertainties of the converged render", _H, _C, short="coverage",
)  # fmt: skip
_PSNR = "peak signal-to-noise ratio against the converged render, both cut to 0...1"
PSNR_RENDERED = _render("psnr_rendered", "dB", "PSNR as rendered", _PSNR, _H, _C)
PSNR_FILTERED = _render("psnr_filtered", "dB", "PSNR filtered", _PSNR, _H, _L, _C, _U)


# --- families --------------------------------------------------------------------------------------------------------

_AT = re.compile(r"mtf_at_(?P<frequency>[0-9.e+-]+?)(?:_(?P<direction>horizontal|vertical|radial))?")


def name_at(frequency: float, direction: str = "") -> str:
    """The name of the MTF at a frequency, along a direction where there are several: mtf_at_0.25_horizontal."""
    return f"mtf_at_{frequency:.6g}" + (f"_{direction}" if direction else "")


def frequency_of(name: str) -> tuple[float, str] | None:
    """The frequency and the direction in the name of an MTF at a frequency; None where it is another number's."""
    match = _AT.fullmatch(name)
    return (float(match["frequency"]), match["direction"] or "") if match else None


MTF, FWHM = "mtf", "fwhm"
FAMILIES = (*EDGE_CROSSINGS.values(), EDGE_MTF_NYQUIST, FWHM, MTF)
"""In limits: numbers along rows and along columns both, or across an edge; `MTF` is that at a frequency."""


def projection_at(distance_mm: float) -> str:
    """The name of a projection's uncertainty at a distance, which may be infinite."""
    return f"{_PROJECTION}at_infinity" if distance_mm == float("inf") else f"{_PROJECTION}at_{distance_mm:.0f}_mm"


def without_photosite(number: Number) -> Number:
    """The number of a map after division by the photosite's MTF."""
    return NUMBERS[f"{number}{_WITHOUT_PHOTOSITE}"]


def label(name: str, unit: str = CYCLES) -> str:
    """A number in words, for pages; `unit` is that of the frequency in its name, where it has one."""
    return _words(name, unit)[0]


def short(name: str, unit: str = CYCLES) -> str:
    """A number in few words, for tables and terminals."""
    return _words(name, unit)[1]


def _words(name: str, unit: str) -> tuple[str, str]:
    if (number := NUMBERS.get(name)) is not None:
        return number.label, number.short
    if (at := frequency_of(name)) is not None:
        words, brief = DIRECTIONS.get(at[1], ("across the edge", "edge"))
        return f"MTF at {at[0]:.4g} {unit} {words}", f"at {at[0]:.4g}, {brief}"
    if name.endswith(MEDIAN):
        words, brief = _words(name.removesuffix(MEDIAN), unit)
        return f"{words}, median over the frame", brief
    if name.startswith(_PROJECTION):
        place = name.removeprefix(f"{_PROJECTION}at_").replace("_", " ")
        return f"Projection uncertainty at {place}", f"projection at {place}"
    return name, name


def in_group(group: Group, names: Iterable[str] | None = None) -> list[Number]:
    """The numbers of a group in their order; of these names alone, where some are given."""
    wanted = None if names is None else set(names)
    return [number for number in NUMBERS.values() if group in number.groups and (wanted is None or number in wanted)]


def reference_text() -> str:
    """All numbers as tables of Markdown, section by section: the manual's reference."""
    lines: list[str] = []
    for section in dict.fromkeys(number.section for number in NUMBERS.values()):
        lines += ["", f"## {section}", "", "| name | unit | definition |", "|---|---|---|"]
        # the numbers of a section, those of one definition together
        groups: dict[tuple[str, str], list[Number]] = {}
        for number in NUMBERS.values():
            if number.section == section:
                groups.setdefault((number.unit, number.definition), []).append(number)
        for (unit, definition), names in groups.items():
            lines.append(f"| {', '.join(f'`{one}`' for one in names)} | {unit} | {definition} |")
    return "\n".join(lines) + "\n"
