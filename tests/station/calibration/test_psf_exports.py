"""PSF fields as files of other programs: read by these where they are installed, by the formats' own rules anyway."""

import io

import numpy as np
import pytest
from scipy.signal import fftconvolve

from procedures import BadInput, BadParameter, write_field
from procedures.field.interpolate import interpolate
from procedures.field.samplings import as_polynomial, powers, whole_psfs
from procedures.psf import Psf, PsfTail
from procedures.psf_field import Node, SpaceVariantBlur
from station.calibration.exports.psf import PSF_FORMATS, read_plane
from tests.program import run

S, K, SHAPE = 4, 17, (60, 90)
PLACES = [(x, y) for y in (8.0, 29.5, 51.0) for x in (10.0, 32.0, 56.0, 79.0)]


def true_psf(x: float, y: float) -> np.ndarray:
    """A Gaussian that is wider, and drawn out, towards the right lower corner."""
    u, v = x / SHAPE[1], y / SHAPE[0]
    at = (np.arange(K) - K // 2) / S
    h = np.exp(-(at**2) / (2 * (0.5 + 0.2 * u) ** 2)) * np.exp(-((at[:, None] - 0.2 * v) ** 2) / (2 * 0.55**2))
    return h / h.sum()


def node(x: float, y: float, number: int) -> Node:
    tail = PsfTail(np.array([0.03]), np.full((1, 1), 1e-8), np.zeros((K * K, 1)))
    psf = Psf(true_psf(x, y), S, 1e-10 * np.eye(K * K), tail)
    return Node(np.array([x, y]), 1e-4 * np.eye(2), 2 * np.array([x, y]), psf, "made", number)


@pytest.fixture(scope="module")
def estimate():
    return interpolate("G1", SHAPE, [node(x, y, i) for i, (x, y) in enumerate(PLACES)])


@pytest.fixture(scope="module")
def field(estimate):
    return estimate.field


def cards(data: bytes) -> dict[str, str]:
    head = data[: data.index(b"END" + b" " * 77)].decode("ascii")
    lines = [head[i : i + 80] for i in range(0, len(head), 80)]
    return {line[:8].strip(): line[10:].strip() for line in lines if line[8:10] == "= "}


def test_stdpsf_holds_the_psfs_of_its_grid(field):
    made = PSF_FORMATS["stdpsf"](field)
    head = cards(made.data)
    shape = int(head["NAXIS3"]), int(head["NAXIS2"]), int(head["NAXIS1"])
    start = -(-(made.data.index(b"END" + b" " * 77) + 80) // 2880) * 2880
    cube = np.frombuffer(made.data, ">f4", count=int(np.prod(shape)), offset=start).reshape(shape)
    nx = int(head["NXPSFS"])
    x, y = int(head["IPSFX03"]) - 1, int(head["JPSFY02"]) - 1  # the format counts from 1
    np.testing.assert_allclose(cube[nx + 2], S**2 * whole_psfs(field, np.array([[x, y]]))[0], rtol=1e-5, atol=1e-7)
    assert "linear interpolation errs by" in made.lost[0]


@pytest.mark.slow
def test_photutils_reads_the_grid_and_sees_the_psf(field, tmp_path):
    psf = pytest.importorskip("photutils.psf", reason="photutils reads these files")
    path = tmp_path / "field.fits"
    path.write_bytes(PSF_FORMATS["stdpsf"](field).data)
    model = psf.GriddedPSFModel.read(str(path), format="stdpsf")
    x, y = (round(v) for v in model.meta["grid_xypos"][9])
    rows, columns = np.mgrid[y - 2 : y + 3, x - 2 : x + 3]
    seen = model.evaluate(columns.astype(float), rows.astype(float), 1.0, x, y)
    whole = whole_psfs(field, np.array([[x, y]]))[0]
    middle = len(whole) // 2
    expected = S**2 * whole[middle - 2 * S : middle + 2 * S + 1 : S, middle - 2 * S : middle + 2 * S + 1 : S]
    np.testing.assert_allclose(seen, expected, atol=1e-5 * expected.max())


@pytest.mark.slow
def test_a_polynomial_over_the_frame_is_the_field_of_its_sampling(field):
    coarse = interpolate(
        "G1", SHAPE, [Node(n.position, n.position_covariance, n.sensor_position, Psf(n.psf.h, 3, n.psf.covariance),
                           number=n.number) for n in field.nodes]
    ).field  # fmt: skip
    with pytest.raises(BadParameter, match="4 samples per pixel; the field has 3"):
        PSF_FORMATS["stdpsf"](coarse)
    estimate = as_polynomial(field, allowed=0.002)
    point = np.array([[40.0, 22.0]])
    place = (point - estimate.centre) / estimate.scale
    made = np.tensordot(powers(place, estimate.degree)[0], estimate.images, axes=1)
    true = whole_psfs(field, point)[0]
    assert np.linalg.norm(made - true) <= 1.5 * max(estimate.lost, 1e-6) * np.linalg.norm(true)


@pytest.mark.slow
def test_galsim_reads_the_polynomial_and_sees_the_psf(field, tmp_path):
    galsim = pytest.importorskip("galsim", reason="galsim reads these files")
    from galsim.des import DES_PSFEx

    path = tmp_path / "field.psf"
    made = PSF_FORMATS["psfex"](field)
    path.write_bytes(made.data)
    read = DES_PSFEx(str(path))
    seen = read.getPSFArray(galsim.PositionD(41.0, 23.0))  # the first pixel is 1
    true = whole_psfs(field, np.array([[40.0, 22.0]]))[0]
    assert np.linalg.norm(seen - true) < 0.005 * np.linalg.norm(true)
    assert read.getSampleScale() == 1 / S


def test_filters_and_multipliers_blur_as_the_field_does(field):
    made = np.load(io.BytesIO(PSF_FORMATS["deepinv"](field).data), allow_pickle=False)
    filters, multipliers = made["filters"], made["multipliers"]
    assert filters.shape[:3] == multipliers.shape[:3]
    assert multipliers.shape[3:] == SHAPE
    scene = np.random.default_rng(3).random(SHAPE)
    seen = sum(fftconvolve(w * scene, h, mode="same") for h, w in zip(filters[0, 0], multipliers[0, 0], strict=True))
    np.testing.assert_allclose(seen, SpaceVariantBlur(field).blur(scene), atol=1e-5)


@pytest.mark.slow
def test_the_command_exports_a_field(estimate, tmp_path):
    write_field(tmp_path / "field.h5", {"G1": estimate}, {}, [], {})
    run("export", tmp_path, "--to", "psfex", tmp_path / "field.psf", says="a polynomial of degree")
    assert (tmp_path / "field.psf").stat().st_size % 2880 == 0
    with pytest.raises(BadParameter, match="has the planes G1, not 'B'"):
        read_plane(tmp_path, "B")
    with pytest.raises(BadInput, match="no file"):
        read_plane(tmp_path / "no.h5", None)
