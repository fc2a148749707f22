import json

import numpy as np
import pytest

from tests.program import run


@pytest.fixture
def small(rng, tmp_path):
    """A film's file made of raw samples: a grey wall beside a white one."""
    level = np.where(np.arange(26) < 13, 0.3, 1.2)[None, :, None, None]
    path = tmp_path / "small.npz"
    np.savez(path, samples=level * rng.gamma(1.0, 1.0, (24, 26, 32, 3)))
    return path


def record_of(folder):
    return json.loads((folder / "result.json").read_text())


@pytest.mark.slow
def test_a_render_is_filtered_and_measured(shared_data, tmp_path):
    cornell = shared_data / "rays" / "cornell_00064_f16.npz"
    run("rays", cornell, "--reference", shared_data / "rays" / "cornell_reference.npz", "--out", tmp_path)
    names = ["filtered.png", "filtered.tiff", "rays.html", "result.json", "similar.npy"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    record = record_of(tmp_path)
    assert record["schema"] == "station/rays/1"
    assert record["verdict"] == "pass"
    assert record["parameters"] == {"kappa": 1.0, "scales": 3, "search": 6, "patch": 1}
    decibels = record["psnr_db"]
    assert decibels["input"]["clipped"] == pytest.approx(27.02, abs=0.005)  # as published with the data
    assert decibels["filtered"]["clipped"] > decibels["input"]["clipped"] + 15


def test_the_tiff_is_linear_and_in_order(small, tmp_path):
    import cv2

    run("rays", small, "--out", tmp_path / "out", "--scales", "2")
    picture = cv2.imread(str(tmp_path / "out" / "filtered.tiff"), cv2.IMREAD_UNCHANGED)
    assert (picture.dtype, picture.shape) == (np.float32, (24, 26, 3))
    # noise of a pixel's mean is level / sqrt(32); 24 x 10 pixels of each wall
    assert picture[:, :10].mean() == pytest.approx(0.3, abs=4 * 0.3 / np.sqrt(32 * 240))
    assert picture[:, -10:].mean() == pytest.approx(1.2, abs=4 * 1.2 / np.sqrt(32 * 240))


def test_numbers_without_an_uncertainty_are_limited_and_certified(small, tmp_path):
    (tmp_path / "limits.toml").write_text("[limits]\nmean_samples = { max = 31 }\ndropped_samples = { max = 0 }\n")
    words = "--scales", "1", "--specification", tmp_path / "limits.toml", "--certificate"
    run("rays", small, *words, "--out", tmp_path / "out", code=1, says="the limit Samples per pixel ≤ 31 is missed: 32")
    assert record_of(tmp_path / "out")["specification"]["verdict"] == "does not meet"
    certificate = (tmp_path / "out" / "certificate.html").read_text()
    assert "Similar patches per pixel" in certificate
    assert "PSF" not in certificate  # a render has none


@pytest.mark.nightly
def test_a_blend_has_weights_an_uncertainty_and_layers(small, tmp_path):
    pytest.importorskip("OpenEXR", reason="OpenEXR is an extra")
    from procedures.reading.exr import read_exr

    run("rays", small, "--blend", "--exr", "--scales", "2", "--out", tmp_path / "out")
    record = record_of(tmp_path / "out")
    assert sum(record["blend"].values()) == pytest.approx(1.0)
    assert record["parameters"]["blend"] is True
    channels, _ = read_exr(tmp_path / "out" / "filtered.exr", ["R", "uncertainty.R"])
    assert channels["R"][:, :10].mean() == pytest.approx(0.3, abs=4 * 0.3 / np.sqrt(32 * 240))
    assert 0 < np.median(channels["uncertainty.R"]) < 0.3 / np.sqrt(32)  # less than the noise of a pixel


@pytest.mark.parametrize(
    ("words", "says"),
    [(["--oidn"], "--oidn without --blend"), (["--blend", "--neighbour", "other.npz"], "--blend with --neighbour")],
)
def test_a_blend_of_other_films_is_refused(small, tmp_path, words, says):
    (tmp_path / "other.npz").write_bytes(small.read_bytes())
    words = [tmp_path / word if word.endswith(".npz") else word for word in words]
    run("rays", small, *words, "--out", tmp_path / "out", code=2, says=says)


def test_a_copy_of_a_film_adds_no_samples(small, tmp_path):
    (tmp_path / "copy.npz").write_bytes(small.read_bytes())
    words = "--add", tmp_path / "copy.npz", "--scales", "1", "--out", tmp_path / "out"
    run("rays", small, *words, code=4, says="copy.npz has the content of")


def test_the_published_filter_ends_similarity_at_a_threshold(small, tmp_path):
    run("rays", small, "--out", tmp_path / "ours", "--scales", "1")
    run("rays", small, "--published", "--out", tmp_path / "paper", "--scales", "1")
    ours, paper = (np.load(tmp_path / name / "similar.npy") for name in ("ours", "paper"))
    # whole patches are alike or not, where ours fade
    np.testing.assert_array_equal(paper, np.round(paper))
    assert (ours != np.round(ours)).any()
    assert record_of(tmp_path / "paper")["parameters"]["published"] is True


def test_a_budget_is_allotted_to_the_pixels(small, tmp_path):
    run("rays", small, "--budget", "5000", "--out", tmp_path / "out", "--scales", "1")
    more = np.load(tmp_path / "out" / "more.npy")
    assert more.shape == (24, 26)
    assert more.sum() == record_of(tmp_path / "out")["more_samples"]["all"] == 5000
    # the bright wall's light varies as its square: a standard deviation four times as large (0.3 and 1.2)
    assert more[:, 15:].mean() > 2 * more[:, :11].mean()


@pytest.fixture
def sequence(rng, tmp_path):
    """Three frames of a grey wall."""
    paths = [tmp_path / f"frame{i}.npz" for i in range(3)]
    for path in paths:
        np.savez(path, samples=0.4 * rng.gamma(1.0, 1.0, (16, 16, 16, 3)))
    return paths


def test_a_sequence_leaves_a_result_of_each_frame(sequence, tmp_path):
    run("rays", *sequence, "--scales", "1", "--out", tmp_path / "out")
    run("rays", sequence[1], "--scales", "1", "--out", tmp_path / "alone")
    run("rays", sequence[1], "--neighbour", sequence[0], "--neighbour", sequence[2], "--scales", "1",
        "--out", tmp_path / "beside")  # fmt: skip
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["frame0", "frame1", "frame2"]
    similar = np.load(tmp_path / "out" / "frame1" / "similar.npy")
    np.testing.assert_array_equal(similar, np.load(tmp_path / "beside" / "similar.npy"))
    assert (similar > np.load(tmp_path / "alone" / "similar.npy")).all()
    used = {i: [source["path"] for source in record_of(tmp_path / "out" / f"frame{i}")["input"]] for i in (0, 1)}
    assert used == {0: [str(sequence[0]), str(sequence[1])], 1: [str(sequence[i]) for i in (1, 0, 2)]}


def test_frames_before_one_that_cannot_be_read_are_kept(sequence, tmp_path):
    sequence[2].write_bytes(b"no film")
    run("rays", *sequence, "--reach", "0", "--scales", "1", "--out", tmp_path / "out", code=4)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["frame0", "frame1"]


def test_the_uncertainty_is_a_picture_and_its_coverage_is_recorded(small, tmp_path):
    import cv2

    if int(cv2.__version__.split(".")[0]) < 5:
        pytest.skip("OpenCV 4 reads three floats as XYZ")
    truth = np.where(np.arange(26) < 13, 0.3, 1.2)[None, :, None]
    np.savez(tmp_path / "truth.npz", reference=np.broadcast_to(truth, (24, 26, 3)))
    reference = ("--reference", tmp_path / "truth.npz")
    run("rays", small, "--uncertainty", "--scales", "1", *reference, "--out", tmp_path / "out")
    sigma = cv2.imread(str(tmp_path / "out" / "uncertainty.tiff"), cv2.IMREAD_UNCHANGED)[..., ::-1]
    filtered = cv2.imread(str(tmp_path / "out" / "filtered.tiff"), cv2.IMREAD_UNCHANGED)[..., ::-1]
    record = record_of(tmp_path / "out")["uncertainty"]
    assert record["coverage_2_sigma"] == pytest.approx((abs(filtered - truth) <= 2 * sigma).mean(), abs=1e-3)
    assert record["coverage_2_sigma"] > 0.8  # 95 %, but two flat walls have few independent errors
    # the bright wall's light varies four times as much
    assert np.median(sigma[:, 16:]) > 2 * np.median(sigma[:, :10])


def test_samples_that_were_cast_since_are_added(sequence, tmp_path):
    run("rays", sequence[0], "--add", sequence[1], "--add", sequence[2], "--scales", "1", "--out", tmp_path / "o")
    assert record_of(tmp_path / "o")["samples_per_pixel"]["mean"] == 48


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["1", "--neighbour", "x.npz"], "--neighbour with 2 films"),
        (["1", "--add", "x.npz"], "--add with 2 films"),
        (["0"], "several films are called frame0"),
    ],
)
def test_options_of_one_film_are_refused_with_several(sequence, tmp_path, options, says):
    second, *others = options
    run("rays", sequence[0], sequence[int(second)], *others, "--out", tmp_path / "out", code=2, says=says)
    assert not (tmp_path / "out").exists()


def test_dropped_samples_are_said(tmp_path, rng):
    samples = rng.random((24, 24, 16, 3))
    samples[3, 4, 5] = np.nan
    np.savez(tmp_path / "s.npz", samples=samples)
    done = run("rays", tmp_path / "s.npz", "--scales", "1", "--out", tmp_path / "out")
    assert "1 of 9216 samples were NaN or infinite and were dropped" in done.output
    assert record_of(tmp_path / "out")["verdict"] == "doubtful"


@pytest.mark.parametrize(
    ("options", "code", "says"),
    [
        (["--kappa", "0"], 2, "kappa must be positive; got 0.0"),
        (["--scales", "0"], 2, "scales must be 1 or more; got 0"),
        (["--scales", "4"], 4, "24 x 26 pixels give 3 x 4"),
        (["--threads", "0"], 2, "--threads"),
    ],
)
def test_what_cannot_be_done_is_refused_and_leaves_nothing(small, tmp_path, options, code, says):
    run("rays", small, *options, "--out", tmp_path / "out", code=code, says=says)
    assert not (tmp_path / "out").exists()


def test_a_reference_of_another_size_is_refused(small, shared_data, tmp_path):
    reference = shared_data / "rays" / "cornell_reference.npz"
    done = run("rays", small, "--scales", "2", "--reference", reference, "--out", tmp_path / "out", code=4)
    assert "got an array (250, 250, 3)" in done.output
