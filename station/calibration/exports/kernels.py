"""A PSF field as filters that general picture programs apply: ImageMagick, G'MIC and GIMP, RawTherapee, NumPy."""

import base64
import io
from collections.abc import Callable, Iterator
from importlib import resources

import numpy as np

from procedures.correction.kernel_tiles import KernelTiles
from procedures.numerics.arrays import Array
from station.calibration.exports import Export


def export_kernels(tiles: KernelTiles, form: str, source: str) -> Export:
    """The filters in a format; source : of the field, for the file's head."""
    text, lost = FORMATS[form](tiles, " ".join(source.split()))
    return Export(text.encode(), (lost,))


def _cells(tiles: KernelTiles) -> Iterator[tuple[tuple[int, int], tuple[int, int, int, int]]]:
    """Row and column of each cell's first node; x, y, width, height of its pixels; the last end with the frame."""
    (rows, columns), x, y = tiles.shape, tiles.x.astype(int), tiles.y.astype(int)
    for i in range(len(y) - 1):
        for j in range(len(x) - 1):
            right = columns if j == len(x) - 2 else x[j + 1]
            below = rows if i == len(y) - 2 else y[i + 1]
            yield (i, j), (int(x[j]), int(y[i]), int(right - x[j]), int(below - y[i]))


def _numbers(values: Array, separator: str = ",") -> str:
    return separator.join(f"{value:.5g}" for value in values.ravel())


def _python(tiles: KernelTiles, source: str) -> tuple[str, str]:
    """The program beside this module with the filters in its last line."""
    file = io.BytesIO()
    np.savez_compressed(
        file, shape=np.array(tiles.shape), kernels=tiles.kernels.astype(np.float32), x=tiles.x.astype(int),
        y=tiles.y.astype(int),
    )  # fmt: skip
    program = resources.files(__package__).joinpath("apply_kernels.py").read_text(encoding="utf-8")
    data = base64.b64encode(file.getvalue()).decode()
    for name, value in (("SOURCE", source), ("FILTERS", data)):
        program = program.replace(f'{name} = ""', f"{name} = {value!r}")
    return (program, "the filters are in single precision")


SHELL = """\
#!/bin/sh
# Inverse filters of {source}, for pictures of {columns} x {rows} pixels.
# Usage: sh THIS IN OUT [srgb|linear]     srgb: IN is encoded by the curve of sRGB; otherwise it is linear in light.
set -e
magick=$(command -v magick || command -v convert)
case "$#${{3-linear}}" in
  [23]linear) to= back= ;;
  3srgb) to="-colorspace RGB -set colorspace sRGB" back="-set colorspace RGB -colorspace sRGB" ;; # as masks are
  *) sed -n 2,3p "$0" >&2; exit 2 ;;
esac
t=$(mktemp -d); trap 'rm -rf "$t"' EXIT
"$magick" "$1" -alpha off $to -depth 16 "$t/in.mpc"
size=$("$magick" identify -format '%wx%h' "$t/in.mpc" 2>/dev/null || identify -format '%wx%h' "$t/in.mpc")
[ "$size" = {columns}x{rows} ] || {{ echo "a picture of {columns}x{rows} pixels is required; got $size" >&2; exit 2; }}
while read -r name kernel; do echo "$kernel" > "$t/$name"; done <<END
{kernels}
END
filtered() {{ # node, crop with the filters' margin, crop of the cell in it
  "$magick" "$t/in.mpc" -crop "$2" +repage {channels} +channel -crop "$3" +repage "$t/$4.mpc"
}}
cell() {{ # number, four nodes, both crops, width, height, steps across and down
  filtered "$2" "$6" "$7" a; filtered "$3" "$6" "$7" b; filtered "$4" "$6" "$7" c; filtered "$5" "$6" "$7" d
  "$magick" -size "1x${{10}}" gradient:black-white -rotate -90 -crop "$8x1+0+0" +repage -scale "$8x$9!" "$t/x.mpc"
  "$magick" -size "1x${{11}}" gradient:black-white -crop "1x$9+0+0" +repage -scale "$8x$9!" "$t/y.mpc"
  "$magick" "$t/a.mpc" "$t/b.mpc" "$t/x.mpc" -composite "$t/top.mpc"
  "$magick" "$t/c.mpc" "$t/d.mpc" "$t/x.mpc" -composite "$t/low.mpc"
  "$magick" "$t/top.mpc" "$t/low.mpc" "$t/y.mpc" -composite "$t/cell$1.mpc"
}}
{cells}
"$magick" {layout} $back -depth 16 "$2"
"""


def _imagemagick(tiles: KernelTiles, source: str) -> tuple[str, str]:
    """A shell script: `-morphology Convolve` with every filter, blended with masks.

    Source: ImageMagick's documentation, "User defined kernel" and "Composite operator of convert". Filters are written
    in it as text, because the default policies of distributions forbid to read them from files.
    """
    size, half = tiles.kernels.shape[-1], tiles.kernels.shape[-1] // 2
    rows, columns = tiles.shape
    colours = "RGB" if tiles.kernels.shape[2] == 3 else "K"
    kernels = [
        f"{i}_{j}{colour} {size}x{size}: " + " ".join(_numbers(row) for row in kernel)
        for (i, j), node in _by_node(tiles)
        for colour, kernel in zip(colours, node, strict=True)
    ]
    channels = " ".join(
        (f"-channel {colour} " if colour != "K" else "") + f'-morphology Convolve "$(cat "$t/$1{colour}")"'
        for colour in colours
    )
    cells, layout = [], []
    for n, ((i, j), (x, y, width, height)) in enumerate(_cells(tiles)):
        left, top = max(x - half, 0), max(y - half, 0)
        right, below = min(x + width + half, columns), min(y + height + half, rows)
        nodes = f"{i}_{j} {i}_{j + 1} {i + 1}_{j} {i + 1}_{j + 1}"
        outer = f"{right - left}x{below - top}+{left}+{top}"
        inner = f"{width}x{height}+{x - left}+{y - top}"
        steps = f"{int(tiles.x[j + 1] - tiles.x[j]) + 1} {int(tiles.y[i + 1] - tiles.y[i]) + 1}"
        cells.append(f"cell {n} {nodes} {outer} {inner} {width} {height} {steps}")
        layout.append(("( " if j == 0 else "") + f'"$t/cell{n}.mpc"' + (" +append )" if j == len(tiles.x) - 2 else ""))
    text = SHELL.format(
        source=source, columns=columns, rows=rows, kernels="\n".join(kernels), channels=channels,
        cells="\n".join(cells), layout=" ".join(layout).replace("( ", r"\( ").replace(" )", r" \)") + " -append",
    )  # fmt: skip
    return (text, "five digits of each coefficient; ImageMagick without HDRI clips at black and white")


def _by_node(tiles: KernelTiles) -> Iterator[tuple[tuple[int, int], Array]]:
    for i, j in np.ndindex(tiles.kernels.shape[:2]):
        yield (i, j), tiles.kernels[i, j]


GMIC = """\
#@gmic
# Inverse filters of {source}, for pictures of {columns} x {rows} pixels.
# Usage: gmic THIS in.tiff station_correct 0 -o out.tiff; 1 for a picture encoded by the curve of sRGB (0 to 255).
# In GIMP: append it to the file of user-defined filters of the plug-in G'MIC; it is listed as "Lens filters".
#@gui Lens filters : station_correct, station_correct
#@gui : Encoding = choice(1,"Linear in light","sRGB")
station_correct : skip "${{1=0}}"
  repeat $! l[$>]
    if w!={columns}||h!={rows} error "a picture of {columns} x {rows} pixels is required" fi
    if $1 srgb2rgb fi
{kernels}
    +f[0] 0
{cells}
    k.
    if $1 c 0,255 rgb2srgb fi
  endl done
"""
CELL = """\
    +crop[0] {left},{top},{right},{below},1
    +convolve. [{a}] +convolve.. [{b}] +convolve... [{c}] +convolve[-4] [{d}] rm[-5]
    crop[-4--1] {half},{half},{inner_right},{inner_below}
    f[-4] "lerp(lerp(i,i(#-3),x/{across}),lerp(i(#-2),i(#-1),x/{across}),y/{down})" rm[-3--1]
    j.. .,{x},{y} rm.
"""


def _gmic(tiles: KernelTiles, source: str) -> tuple[str, str]:
    """A command file: `convolve` with every filter, blended by an expression.

    Source: G'MIC's reference, `convolve` ("one-for-one channel mode"), `fill`, `image`, and `#@gui`.
    """
    half, columns = tiles.kernels.shape[-1] // 2, len(tiles.x)
    kernels = [
        "    (" + "^".join(";".join(_numbers(row) for row in kernel) for kernel in node) + ")"
        for _, node in _by_node(tiles)
    ]
    cells = []
    for (i, j), (x, y, width, height) in _cells(tiles):
        first = 1 + i * columns + j
        cells.append(CELL.format(
            left=x - half, top=y - half, right=x + width + half - 1, below=y + height + half - 1, x=x, y=y,
            a=first, b=first + 1, c=first + columns, d=first + columns + 1, half=half,
            inner_right=half + width - 1, inner_below=half + height - 1,
            across=int(tiles.x[j + 1] - tiles.x[j]), down=int(tiles.y[i + 1] - tiles.y[i]),
        ))  # fmt: skip
    (rows, across) = tiles.shape
    text = GMIC.format(
        source=source, columns=across, rows=rows, kernels="\n".join(kernels), cells="".join(cells).rstrip("\n")
    )
    return (text, "five digits of each coefficient")


PROFILE = """\
[Version]
AppVersion=5.8
Version=346

[PostDemosaicSharpening]
Enabled=true
Contrast=10
AutoContrast=true
AutoRadius=false
DeconvRadius={radius:.2f}
DeconvRadiusOffset={offset:.2f}
DeconvIterCheck=true
DeconvIterations=20
"""
RADIUS = 0.4, 2.0
"""Range of the slider Radius; it and Corner boost together are limited to its end."""


def _rawtherapee(tiles: KernelTiles, source: str) -> tuple[str, str]:
    """A partial processing profile: radius and corner boost of Capture Sharpening, Gaussians by the field.

    Capture Sharpening takes no kernel: its radius is the standard deviation of a Gaussian, which grows linearly from
    the frame's centre by the corner boost. Source: RawTherapee, `rtengine/capturesharpening.cc`.
    """
    rows, columns = tiles.shape
    x, y = np.meshgrid(tiles.x - (columns - 1) / 2, tiles.y - (rows - 1) / 2)
    r = np.hypot(x, y).ravel() / np.hypot(rows / 2, columns / 2)
    design = np.column_stack([np.ones_like(r), r])
    (centre, growth), *_ = np.linalg.lstsq(design, tiles.sigma_px.ravel(), rcond=None)
    radius = float(np.clip(centre, *RADIUS))
    offset = float(np.clip(growth, -0.5, RADIUS[1] - radius))
    differs = float(np.abs(radius + offset * r - tiles.sigma_px.ravel()).max())
    return (
        PROFILE.format(radius=radius, offset=offset),
        f"the PSF is replaced by a round Gaussian of {radius:.2f} pixels at the centre and {radius + offset:.2f} in "
        f"the corners, up to {differs:.2f} pixels from the field's",
    )


FORMATS: dict[str, Callable[[KernelTiles, str], tuple[str, str]]] = {
    "python": _python,
    "imagemagick": _imagemagick,
    "gmic": _gmic,
    "rawtherapee": _rawtherapee,
}
