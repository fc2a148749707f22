import numpy as np
import pytest

from simulators.rays.path_tracer import (
    Box,
    InfinitePlane,
    Material,
    RayScene,
    Rectangle,
    Sphere,
    ThinLensCamera,
    blur_diameter_px,
    cast,
    depth_map,
)

WHITE = Material((1.0, 1.0, 1.0))


class Recorder:
    """Keeps every sample, in the order in which its pixel got them."""

    def __init__(self, rows, columns):
        self.size, self.pixels, self.colours = (rows, columns), [np.zeros(0, int)], [np.zeros((0, 3))]

    def __call__(self, row, column, colour):
        self.pixels.append(row * self.size[1] + column)
        self.colours.append(colour)

    def count(self):
        return np.bincount(np.concatenate(self.pixels), minlength=np.prod(self.size)).reshape(self.size)

    def array(self):
        """(rows, columns, n, 3), where every pixel got as many."""
        order = np.argsort(np.concatenate(self.pixels), kind="stable")
        return np.concatenate(self.colours)[order].reshape(*self.size, -1, 3)


def render(scene, camera, n, seed=1, **options):
    recorder = Recorder(camera.rows, camera.columns)
    cast(scene, camera, n, recorder, seed=seed, **options)
    return recorder.array()


def lamp(x, y, z, width, radiance=1.0):
    """A square lamp that shines towards the camera."""
    corner = (x - width / 2, y - width / 2, z)
    shine = Material((0.0, 0.0, 0.0), emission=(radiance,) * 3)
    return Rectangle(corner, (0.0, width, 0.0), (width, 0.0, 0.0), shine)


def spread(picture):
    """Centroid (x, y) and variance (x, y) of a picture's light, pixels, pixel centres at integers."""
    y, x = np.indices(picture.shape)
    light = picture / picture.sum()
    centre = np.array([(light * x).sum(), (light * y).sum()])
    return centre, np.array([(light * (x - centre[0]) ** 2).sum(), (light * (y - centre[1]) ** 2).sum()])


@pytest.mark.parametrize(
    "shape",
    [
        pytest.param(Sphere((0, 0, 1000), 300, WHITE), marks=pytest.mark.nightly),
        Box((0, 0, 1000), (250, 200, 300), WHITE, turn_rad=0.6),
        InfinitePlane((0, 100, 0), (0, -3, 0), WHITE),
    ],
    ids=["sphere", "box", "plane"],
)
def test_a_perfectly_white_convex_thing_is_invisible_in_even_light(shape):
    camera = ThinLensCamera(8, 8, pitch_um=4000)
    samples = render(RayScene([shape], sky=(0.7, 0.7, 0.7)), camera, 16)
    np.testing.assert_allclose(samples, 0.7, rtol=1e-9)


def test_light_is_conserved_by_gloss_and_by_a_closed_room():
    ball = Sphere((0, 0, 1000), 400, Material((1.0, 1.0, 1.0), gloss=0.7, exponent=20))
    camera = ThinLensCamera(8, 8, pitch_um=4000)
    picture = render(RayScene([ball], sky=(1.0, 1.0, 1.0)), camera, 400).mean((2, 3))
    # the lobe that would go below the surface is lost, so the rim is darker; four standard deviations above 1 at most
    assert picture.max() < 1.05
    assert picture[4, 4] > 0.9
    # every wall shines with 1/2 and sends back 1/2: 1/2 + 1/4 + ... of 12 surfaces
    wall = Material((0.5, 0.5, 0.5), emission=(0.5, 0.5, 0.5))
    s, walls = 1000.0, []
    for axis in range(3):
        u, v, n = np.roll(np.eye(3), axis, axis=0)
        for side in (-1, 1):
            a, b = (u, v) if side < 0 else (v, u)  # fronts face inside
            walls.append(Rectangle(tuple(side * n * s - (u + v) * s), tuple(2 * s * a), tuple(2 * s * b), wall))
    samples = render(RayScene(walls), ThinLensCamera(10, 10, pitch_um=5000), 100)
    error = samples.std() / np.sqrt(samples.size / 3)
    assert samples.mean() == pytest.approx(1.0 - 2.0**-12, abs=4 * error)
    assert error < 0.01


@pytest.mark.parametrize("height", [300.0, 900.0])
def test_brightness_under_a_lamp_falls_off_as_the_view_factor_says(height):
    floor = InfinitePlane((0, 0, 1000), (0, 0, -1), Material((0.6, 0.6, 0.6)))
    shade = Material((0.0, 0.0, 0.0), emission=(5.0, 5.0, 5.0))
    side = 200.0
    above = Rectangle((-side, -side, 1000 - height), (2 * side, 0, 0), (0, 2 * side, 0), shade)
    # the camera looks from the side, past the lamp, at the floor's point under its middle
    camera = ThinLensCamera(3, 3, pitch_um=10, position_mm=(-2000.0, 0.0, 850.0), target_mm=(0.0, 0.0, 1000.0))
    samples = render(RayScene([floor, above]), camera, 4000)[..., 0]
    a = side / height  # one of four quarters: Siegel, Howell, configuration 1, element to a parallel rectangle's corner
    quarter = 2 * a / np.sqrt(1 + a * a) * np.arctan(a / np.sqrt(1 + a * a)) / (2 * np.pi)
    error = samples.std() / np.sqrt(samples.size)
    assert samples.mean() == pytest.approx(0.6 * 5.0 * 4 * quarter, abs=4 * error)


@pytest.mark.parametrize("exponent", [1.0, 50.0])
def test_aiming_at_lights_changes_noise_and_not_the_mean(exponent):
    # the same room lit by one lamp, or by that lamp in two halves and a black one far behind: other odds, same light
    floor = InfinitePlane((0, 300, 0), (0, -1, 0), Material((0.5, 0.5, 0.5), gloss=0.5, exponent=exponent))
    shine = Material((0.0, 0.0, 0.0), emission=(4.0, 4.0, 4.0))
    down = [Rectangle((x, -200, 800), (0, 0, 300), (w, 0, 0), shine) for x, w in ((-200, 400), (-200, 150), (-50, 250))]
    camera = ThinLensCamera(6, 6, pitch_um=1000, target_mm=(0, 300, 900))
    one, two = (render(RayScene([floor, *lamps]), camera, 2000, seed) for seed, lamps in ((1, down[:1]), (2, down[1:])))
    error = np.hypot(
        *(s.mean(2).std() / np.sqrt(s[..., 0].size) + s.std() / np.sqrt(s[..., 0].size) for s in (one, two))
    )
    assert one.mean() == pytest.approx(two.mean(), abs=4 * error)


@pytest.mark.slow
@pytest.mark.parametrize("z", [700.0, 1000.0, 2500.0])
def test_defocus_is_the_disc_of_a_thin_lens(z):
    camera = ThinLensCamera(60, 60, focal_mm=50, f_number=2.0, focus_mm=1000, pitch_um=50)
    width = 0.01 * z
    picture = render(RayScene([lamp(0, 0, z, width)]), camera, 300)[..., 0].mean(2)
    centre, variance = spread(picture)
    diameter = blur_diameter_px(camera, z)
    pixel_mm = 0.05 * (1000 - 50) / 50 * z / 1000  # of the plane at z
    # a disc has D^2 / 16 along an axis, a square w^2 / 12, and so has the pixel
    expected = diameter**2 / 16 + (width / pixel_mm) ** 2 / 12 + 1 / 12
    np.testing.assert_allclose(variance, expected, rtol=0.06)  # 300 samples in some hundred pixels
    np.testing.assert_allclose(centre, 29.5, atol=0.25)


@pytest.mark.slow
def test_depths_are_along_the_axis():
    # a wall across the axis is as far at the rim as in the middle; a ball's front is nearer; beside them is nothing
    sheet = Rectangle((-200, -200, 900), (400, 0, 0), (0, 400, 0), WHITE)
    camera = ThinLensCamera(31, 61, pitch_um=1000)
    depth = depth_map(RayScene([sheet, Sphere((0, 0, 900), 50, WHITE)]), camera)
    assert depth[15, 30] == pytest.approx(850.0)
    assert depth[5, 25] == pytest.approx(900.0)
    assert depth[15, 0] == np.inf
    # and the defocus at infinity is that of the focus at twice the distance, doubled
    lens = ThinLensCamera(4, 4, f_number=2.0)
    far, near = blur_diameter_px(lens, [np.inf, 2000.0])
    assert far == pytest.approx(2 * near)


def test_depth_of_field_vanishes_through_a_pinhole():
    assert blur_diameter_px(ThinLensCamera(10, 10), 300.0) == 0.0


@pytest.mark.slow
def test_a_moving_camera_smears_against_its_motion():
    # 30 pixels to the right while the shutter is open: a thing ends 30 pixels further left
    camera = ThinLensCamera(
        8, 70, focal_mm=50, focus_mm=1000, pitch_um=50, exposure_s=0.1, velocity_mm_s=(30 * 0.95 / 0.1, 0.0, 0.0)
    )
    picture = render(RayScene([lamp(0, 0, 1000, 1.0)]), camera, 2000)[..., 0].mean(2)
    centre, variance = spread(picture)
    # some 2000 samples find the lamp: 30 / sqrt(12) / sqrt(2000) is a standard deviation of 0.2
    assert centre[0] == pytest.approx(34.5 - 15, abs=0.8)
    assert variance[0] == pytest.approx(30**2 / 12 + (1 / 0.95) ** 2 / 12 + 1 / 12, rel=0.08)
    assert variance[1] < 0.5


def test_textures_and_mirrors_are_seen_the_right_way_round():
    texture = np.zeros((2, 3, 3))
    texture[0, 0] = 1.0, 0.2, 0.2
    texture[1, 2] = 0.2, 0.2, 1.0
    sheet = Rectangle((-150, -100, 1000), (300, 0, 0), (0, 200, 0), Material((1, 1, 1), texture=texture))
    camera = ThinLensCamera(2, 3, focal_mm=50, focus_mm=1000, pitch_um=100 / 19 * 1000)
    picture = render(RayScene([sheet], sky=(1, 1, 1)), camera, 50).mean(2)
    np.testing.assert_allclose(picture, texture, atol=1e-9)
    mirror = InfinitePlane((0, 0, 1000), (0, 0, -1), Material((0, 0, 0), gloss=1.0, exponent=1e7))
    shine = Material((0.0, 0.0, 0.0), emission=(1.0, 1.0, 1.0))
    behind = Rectangle((200, -100, -1000), (200, 0, 0), (0, 200, 0), shine)  # shines forwards, towards the mirror
    camera = ThinLensCamera(9, 31, focal_mm=50, focus_mm=1000, pitch_um=1000)
    picture = render(RayScene([mirror, behind]), camera, 60)[..., 0].mean(2)
    # its image is 3000 mm away, 200 to 400 to the right: pixels of 19 mm at 1 m, 57 mm there
    centre, _ = spread(picture)
    assert centre[0] == pytest.approx(15 + 300 / 57, abs=0.15)
    assert centre[1] == pytest.approx(4, abs=0.15)


@pytest.fixture
def scene():
    return RayScene(
        [InfinitePlane((0, 200, 0), (0, -1, 0), Material((0.6, 0.5, 0.4))), lamp(0, -300, 1500, 300, 3.0)],
        sky=(0.1, 0.1, 0.2),
    )


CAMERA = ThinLensCamera(40, 70, pitch_um=400, f_number=2.0)


def test_samples_depend_on_the_seed_and_wish_alone(scene, rng):
    whole = render(scene, CAMERA, 12)
    again = render(scene, CAMERA, 12, threads=3)
    np.testing.assert_array_equal(whole, again)
    parts = Recorder(40, 70)
    taken = np.zeros((40, 70), int)
    for wanted in (5, 6, 12):
        cast(scene, CAMERA, wanted, parts, seed=1, taken=taken)
        taken = parts.count()
    np.testing.assert_array_equal(whole, parts.array())
    one, two = (render(scene, CAMERA, 16, seed) for seed in (1, 2))
    assert (one != two).any((2, 3)).mean() > 0.5
    error = np.hypot(one.std(), two.std()) / np.sqrt(one.size / 3)
    assert one.mean() == pytest.approx(two.mean(), abs=4 * error)
    wanted = rng.integers(0, 5, (40, 70))
    recorder, collected = Recorder(40, 70), []
    cast(scene, CAMERA, wanted, recorder, seed=1, progress=lambda done, total: collected.append((done, total)))
    np.testing.assert_array_equal(recorder.count(), wanted)
    assert collected[-1] == (wanted.sum(), wanted.sum())


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"wanted": np.zeros((2, 2), int)}, r"the picture is 40 x 70; got samples wanted of shape \(2, 2\)"),
        ({"taken": np.zeros((3, 3), int)}, r"got samples taken of shape \(3, 3\)"),
    ],
)
def test_maps_of_another_size_are_refused(scene, wrong, says):
    with pytest.raises(ValueError, match=says):
        cast(scene, CAMERA, receive=print, seed=1, **({"wanted": 1} | wrong))


@pytest.mark.parametrize(
    ("wrong", "says"),
    [({"focus_mm": 40.0}, "cannot focus at 40"), ({"rows": 0}, "0 x 10 pixels"), ({"f_number": 0.0}, "f/0")],
)
def test_cameras_that_cannot_be_are_refused(wrong, says):
    with pytest.raises(ValueError, match=says):
        ThinLensCamera(**({"rows": 10, "columns": 10} | wrong))


def test_scenes_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="needs at least one shape"):
        cast(RayScene([]), CAMERA, 1, print, seed=1)
    with pytest.raises(ValueError, match="only rectangles shine"):
        cast(RayScene([Sphere((0, 0, 9), 1, Material(emission=(1, 1, 1)))]), CAMERA, 1, print, seed=1)
    with pytest.raises(ValueError, match="straight up or down"):
        cast(RayScene([lamp(0, 0, 9, 1)]), ThinLensCamera(4, 4, target_mm=(0, 5, 0)), 1, print, seed=1)
