"""Pictures of a certificate: MTF with its band, PSF, and the code with the digest of the record."""

import io
from collections.abc import Sequence

import cv2
import matplotlib
import numpy as np
from reportlab.graphics.barcode.qrencoder import QRCode, QRErrorCorrectLevel

from station.drawing.colours import INK, PLANE_COLOURS
from station.drawing.plots import bare, curve, legend, picture
from station.drawing.style import STYLE, axes_grid
from station.results.plane_result import PlaneResult

DPI = 200
QR_VERSION = 6
"""41 x 41 modules: room for 106 bytes at error correction level M (ISO/IEC 18004)."""
QR_PIXELS, QR_RIM = 6, 4


def curves_figure(planes: Sequence[PlaneResult]) -> bytes | None:
    """The MTF of the planes with bands of 95 %, and the PSF of the first, as PNG; None without either."""
    drawn = [one for one in planes if "frequency" in one.curves and _names(one)]
    sampled = next((one for one in planes if one.samples is not None), None)
    if not drawn:
        return None
    figure, axes = axes_grid(6.9, 1.9, 1, 2, rim_in=(0.58, 0.1, 0.42, 0.24), width_ratios=(3, 1), wspace=0.1)
    left, right = axes[0]
    for plane in drawn:
        for name, dashes in zip(_names(plane), ("-", "--"), strict=False):
            colour = PLANE_COLOURS.get(plane.name, INK)
            x, y = plane.curves["frequency"], plane.curves[name]
            curve(left, x, y, plane.curves.get(f"{name}_uncertainty"), colour=colour, ls=dashes,
                  label=f"{plane.name} {name}" if name != "mtf" else plane.name)  # fmt: skip
    left.set(xlabel=f"frequency, {drawn[0].unit}", ylabel="MTF", xlim=(0, None), ylim=(0, 1.05))
    legend(left, "upper right", fontsize=7)
    bare(right)
    if sampled is not None and sampled.samples is not None:
        picture(right, sampled.samples)
        right.set_title(f"PSF, {sampled.name}")
    data = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(data, format="png", dpi=DPI, metadata={"Software": None})
    return data.getvalue()


def _names(plane: PlaneResult) -> list[str]:
    return [one for one in ("horizontal", "vertical", "mtf") if one in plane.curves]


def qr_code(text: str) -> bytes:
    """A text as a QR code (ISO/IEC 18004), PNG."""
    code = QRCode(QR_VERSION, QRErrorCorrectLevel.M)
    code.addData(text)
    code.make()
    modules = np.pad(np.array(code.modules, dtype=bool), QR_RIM)
    image = np.where(np.kron(modules, np.ones((QR_PIXELS, QR_PIXELS), dtype=bool)), 0, 255).astype(np.uint8)
    return cv2.imencode(".png", image)[1].tobytes()
