"""Light along one path at a time: from the sensor through the lens into the scene, and from surface to surface.

Every sample has its own stream of random numbers, a hash of (seed, pixel, number of the sample): the same whatever
tile, thread or session casts it. Light is sought in both ways, by aiming at the lights and by following the surface's
own scattering, weighted by the balance heuristic (Veach 1997, section 9.2).
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from procedures.numerics.compiled import compiled
from simulators.rays.ray_shapes import (
    NEAR_MM,
    Doubles,
    Ints,
    SceneArrays,
    Vector,
    along,
    colour_at,
    cross,
    dot,
    meet,
    outward,
    times,
    unit,
    vector,
)

Words = npt.NDArray[np.uint64]

LONGEST = 12  # surfaces a path may touch
ROULETTE = 4  # surfaces after which a path survives with the probability of its throughput

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX2 = np.uint64(0x94D049BB133111EB)
_PIXELS = np.uint64(0xD1342543DE82EF95)
_SAMPLES = np.uint64(0xAF251AF3B0F025B5)


class RayCamera(NamedTuple):
    """The camera as numbers: position (3,) at shutter opening and its change until closing; axes (3, 3) right, down,
    forward; aperture radius, focus distance, and image size on the plane in focus per pixel, millimetres; rows and
    columns."""

    position: Doubles
    axes: Doubles
    travel: Doubles
    aperture_radius_mm: float
    focus_mm: float
    pixel_at_focus_mm: float
    rows: int
    columns: int


@compiled
def mixed(z: np.uint64) -> np.uint64:
    """A hashed word (the finaliser of SplitMix64)."""
    z = (z ^ (z >> np.uint64(30))) * _MIX1
    z = (z ^ (z >> np.uint64(27))) * _MIX2
    return z ^ (z >> np.uint64(31))


@compiled
def draw(state: Words) -> float:
    """The next number of the stream, uniform in [0, 1)."""
    state[0] += _GOLDEN
    return float(mixed(state[0]) >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@compiled
def around(axis: Vector, cosine: float, angle: float) -> Vector:
    """The unit vector at this cosine from the axis and this angle around it."""
    helper = (1.0, 0.0, 0.0) if abs(axis[0]) < 0.5 else (0.0, 1.0, 0.0)
    a = unit(cross(helper, axis))
    b = cross(axis, a)
    sine = np.sqrt(max(0.0, 1.0 - cosine * cosine))
    x, y = sine * np.cos(angle), sine * np.sin(angle)
    return (
        x * a[0] + y * b[0] + cosine * axis[0],
        x * a[1] + y * b[1] + cosine * axis[1],
        x * a[2] + y * b[2] + cosine * axis[2],
    )


@compiled
def leave_camera(lens: RayCamera, row: int, column: int, state: Words) -> tuple[Vector, Vector]:
    """A ray through a random place of the pixel and of the aperture at a random time: origin and unit direction."""
    x = (column + draw(state) - 0.5 * lens.columns) * lens.pixel_at_focus_mm
    y = (row + draw(state) - 0.5 * lens.rows) * lens.pixel_at_focus_mm
    radius = lens.aperture_radius_mm * np.sqrt(draw(state))
    angle = 2.0 * np.pi * draw(state)
    time = draw(state)
    a, b = radius * np.cos(angle), radius * np.sin(angle)
    right, down, forward = vector(lens.axes[0], 0), vector(lens.axes[1], 0), vector(lens.axes[2], 0)
    centre = along(vector(lens.position, 0), time, vector(lens.travel, 0))
    origin = along(along(centre, a, right), b, down)
    aim = along(along(along((0.0, 0.0, 0.0), x - a, right), y - b, down), lens.focus_mm, forward)
    return origin, unit(aim)


@compiled
def mirrored(normal: Vector, away: Vector) -> Vector:
    """Mirror direction of `away`."""
    double = 2.0 * dot(normal, away)
    return double * normal[0] - away[0], double * normal[1] - away[1], double * normal[2] - away[2]


@compiled
def scattering(gloss: Doubles, albedo: Vector, normal: Vector, away: Vector, to: Vector) -> tuple[Vector, float]:
    """Reflectance times cosine, per colour, and the density per solid angle with which `scatter` chooses `to`.

    Lambert's law, and for the gloss a Phong lobe about the mirror direction, normalised so that it takes its share of
    the light at most (Lafortune, Willems 1994).
    """
    cosine = dot(normal, to)
    if cosine <= 0.0:
        return (0.0, 0.0, 0.0), 0.0
    share, exponent = gloss
    lobe = max(0.0, dot(mirrored(normal, away), to)) ** exponent / (2.0 * np.pi) if share > 0.0 else 0.0
    matt = (1.0 - share) / np.pi
    shine = share * (exponent + 2.0) * lobe
    value = (
        (matt * albedo[0] + shine) * cosine,
        (matt * albedo[1] + shine) * cosine,
        (matt * albedo[2] + shine) * cosine,
    )
    return value, matt * cosine + share * (exponent + 1.0) * lobe


@compiled
def scatter(gloss: Doubles, normal: Vector, away: Vector, state: Words) -> Vector:
    """A direction in which the surface sends light on: cosine-weighted, or in the lobe of its gloss."""
    share, exponent = gloss
    chosen, place, angle = draw(state), draw(state), 2.0 * np.pi * draw(state)
    if chosen < share:
        return around(mirrored(normal, away), place ** (1.0 / (exponent + 1.0)), angle)
    return around(normal, np.sqrt(place), angle)


@compiled
def light_density(world: SceneArrays, shape: int, origin: Vector, point: Vector, direction: Vector) -> float:
    """Density per solid angle, seen from the origin, with which `seek_light` aims at this point of a light."""
    g = world.geometry[shape]
    normal = cross(vector(g, 3), vector(g, 6))  # as long as the rectangle's area
    gap = along(point, -1.0, origin)
    facing = -dot(normal, direction)
    return dot(gap, gap) / (facing * world.lights.size) if facing > 0.0 else 0.0


@compiled
def seek_light(
    world: SceneArrays, own: int, albedo: Vector, point: Vector, normal: Vector, away: Vector, state: Words
) -> Vector:
    """Direct light from a random point of a random lamp, scattered towards `away` by the shape `own`."""
    black = (0.0, 0.0, 0.0)
    if world.lights.size == 0:
        return black
    shape = world.lights[min(int(draw(state) * world.lights.size), world.lights.size - 1)]
    g = world.geometry[shape]
    target = along(along(vector(g, 0), draw(state), vector(g, 3)), draw(state), vector(g, 6))
    gap = along(target, -1.0, point)
    distance = np.sqrt(dot(gap, gap))
    to = unit(gap)
    density = light_density(world, shape, point, target, to)
    value, own_density = scattering(world.gloss[own], albedo, normal, away, to)
    if density <= 0.0 or own_density <= 0.0:
        return black
    if meet(world, point, to, distance * (1.0 - 1e-9) - NEAR_MM)[1] >= 0:
        return black
    weight = 1.0 / (density + own_density)  # balance heuristic: density / (density + own) over density
    shine = times(value, vector(world.emission[shape], 0))
    return weight * shine[0], weight * shine[1], weight * shine[2]


@compiled
def follow(world: SceneArrays, origin: Vector, direction: Vector, state: Words, light: Doubles) -> None:
    """Add the contribution of one path that starts with this ray to `light` (3,)."""
    carried = (1.0, 1.0, 1.0)
    density = 0.0
    for surface in range(LONGEST):
        t, shape = meet(world, origin, direction, np.inf)
        if shape < 0:
            gather(light, carried, vector(world.sky, 0), 1.0)
            return
        point = along(origin, t, direction)
        normal = outward(world, shape, point)
        facing = dot(normal, direction)
        if facing < 0.0 and world.emission[shape].any():
            aimed = light_density(world, shape, origin, point, direction) if surface > 0 else 0.0
            gather(
                light, carried, vector(world.emission[shape], 0), density / (density + aimed) if surface > 0 else 1.0
            )
        if facing > 0.0:
            normal = (-normal[0], -normal[1], -normal[2])
        away = (-direction[0], -direction[1], -direction[2])
        albedo = colour_at(world, shape, point)
        gather(light, carried, seek_light(world, shape, albedo, point, normal, away, state), 1.0)
        direction = scatter(world.gloss[shape], normal, away, state)
        value, density = scattering(world.gloss[shape], albedo, normal, away, direction)
        if density <= 0.0:
            return
        carried = times(carried, (value[0] / density, value[1] / density, value[2] / density))
        if surface >= ROULETTE:
            survival = min(1.0, max(carried[0], carried[1], carried[2]))
            if draw(state) >= survival:
                return
            carried = times(carried, (1.0 / survival, 1.0 / survival, 1.0 / survival))
        origin = point


@compiled
def gather(light: Doubles, carried: Vector, shine: Vector, weight: float) -> None:
    """Add a contribution to the light."""
    for b in range(3):
        light[b] += weight * carried[b] * shine[b]


@compiled
def trace(
    world: SceneArrays, lens: RayCamera, seed: np.uint64, row: Ints, column: Ints, number: Ints, colour: Doubles
) -> None:
    """Samples by pixel and number of the sample in its pixel; fills colour (n, 3)."""
    state = np.empty(1, np.uint64)
    for i in range(row.size):
        pixel = np.uint64(row[i]) * np.uint64(lens.columns) + np.uint64(column[i])
        state[0] = mixed(mixed(seed + pixel * _PIXELS) + np.uint64(number[i]) * _SAMPLES)
        origin, direction = leave_camera(lens, row[i], column[i], state)
        colour[i] = 0.0
        follow(world, origin, direction, state, colour[i])


@compiled
def measure_depths(world: SceneArrays, lens: RayCamera, depth: Doubles) -> None:
    """Fill depth (rows, columns) with the distance along the axis of what the pixels' centres see, nothing moving."""
    forward = vector(lens.axes[2], 0)
    origin = vector(lens.position, 0)
    for row in range(lens.rows):
        for column in range(lens.columns):
            x = (column + 0.5 - 0.5 * lens.columns) * lens.pixel_at_focus_mm
            y = (row + 0.5 - 0.5 * lens.rows) * lens.pixel_at_focus_mm
            aim = along(along((0.0, 0.0, 0.0), x, vector(lens.axes[0], 0)), y, vector(lens.axes[1], 0))
            direction = unit(along(aim, lens.focus_mm, forward))
            depth[row, column] = meet(world, origin, direction, np.inf)[0] * dot(direction, forward)
