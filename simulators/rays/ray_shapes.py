"""Intersection of rays with shapes: distance, normal, position on the surface. Millimetres; x right, y down,
z forward.

A shape is a kind and a row of 16 numbers: plane: point, normal; sphere: centre, radius; rectangle: corner, edge u,
edge v; box: centre, half sizes, and the three axes along which they are measured.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from procedures.numerics.compiled import compiled

Doubles = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Vector = tuple[float, float, float]

PLANE, SPHERE, RECTANGLE, BOX = range(4)
GEOMETRY = 16  # numbers per shape
NEAR_MM = 1e-4  # a ray that leaves a surface ignores intersections within this distance


class SceneArrays(NamedTuple):
    """A scene as arrays for the kernels.

    Per shape: kind (n,), geometry (n, 16), albedo (n, 3), gloss (n, 2) as share and exponent, emission (n, 3), texture
    (n, 4) as first texel, rows, columns and whether there is one; texels (t, 3); lights (l,) the shapes that shine; sky
    (3,) the radiance of what is not there.
    """

    kind: Ints
    geometry: Doubles
    albedo: Doubles
    gloss: Doubles
    emission: Doubles
    texture: Ints
    texels: Doubles
    lights: Ints
    sky: Doubles


@compiled
def dot(a: Vector, b: Vector) -> float:
    """a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def cross(a: Vector, b: Vector) -> Vector:
    """a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def along(origin: Vector, t: float, direction: Vector) -> Vector:
    """origin + t direction."""
    return origin[0] + t * direction[0], origin[1] + t * direction[1], origin[2] + t * direction[2]


@compiled
def times(a: Vector, b: Vector) -> Vector:
    """Product component by component."""
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@compiled
def unit(a: Vector) -> Vector:
    """a / |a|."""
    s = 1.0 / np.sqrt(dot(a, a))
    return s * a[0], s * a[1], s * a[2]


@compiled
def vector(row: Doubles, first: int) -> Vector:
    """Three numbers of a row."""
    return row[first], row[first + 1], row[first + 2]


@compiled
def meet_plane(g: Doubles, origin: Vector, direction: Vector) -> float:
    """Distance along the ray, infinite if it misses."""
    normal = vector(g, 3)
    slope = dot(normal, direction)
    t = dot(normal, along(vector(g, 0), -1.0, origin)) / slope
    return t if slope != 0.0 and t > NEAR_MM else np.inf


@compiled
def meet_sphere(g: Doubles, origin: Vector, direction: Vector) -> float:
    """Distance along the ray (of unit direction), infinite if it misses."""
    away = along(origin, -1.0, vector(g, 0))
    b = dot(away, direction)
    rest = b * b - dot(away, away) + g[3] * g[3]
    if rest < 0.0:
        return np.inf
    root = float(np.sqrt(rest))
    near = -b - root
    if near > NEAR_MM:
        return near
    far = -b + root
    return far if far > NEAR_MM else np.inf


@compiled
def meet_rectangle(g: Doubles, origin: Vector, direction: Vector) -> float:
    """Distance along the ray, infinite if it misses."""
    u, v = vector(g, 3), vector(g, 6)
    normal = cross(u, v)
    slope = dot(normal, direction)
    if slope == 0.0:
        return np.inf
    t = dot(normal, along(vector(g, 0), -1.0, origin)) / slope
    if t <= NEAR_MM:
        return np.inf
    a, b = place_on_rectangle(g, along(origin, t, direction))
    return t if 0.0 <= a <= 1.0 and 0.0 <= b <= 1.0 else np.inf


@compiled
def place_on_rectangle(g: Doubles, point: Vector) -> tuple[float, float]:
    """Coordinates of the point along the two (perpendicular) edges, each from 0 to 1."""
    u, v = vector(g, 3), vector(g, 6)
    inside = along(point, -1.0, vector(g, 0))
    return dot(inside, u) / dot(u, u), dot(inside, v) / dot(v, v)


@compiled
def meet_box(g: Doubles, origin: Vector, direction: Vector) -> float:
    """Distance along the ray, infinite if it misses; slabs in the box's own axes."""
    enter, leave = -np.inf, np.inf
    away = along(origin, -1.0, vector(g, 0))
    for axis in range(3):
        e = vector(g, 6 + 3 * axis) if axis < 2 else cross(vector(g, 6), vector(g, 9))
        o, d, half = dot(away, e), dot(direction, e), g[3 + axis]
        if d == 0.0:
            if abs(o) > half:
                return np.inf
            continue
        t0, t1 = (-half - o) / d, (half - o) / d
        enter = max(enter, min(t0, t1))
        leave = min(leave, max(t0, t1))
    if enter > leave:
        return np.inf
    if enter > NEAR_MM:
        return enter
    return leave if leave > NEAR_MM else np.inf


@compiled
def box_normal(g: Doubles, point: Vector) -> Vector:
    """Outward normal of the face nearest to the point."""
    away = along(point, -1.0, vector(g, 0))
    best = -1.0
    normal = (0.0, 0.0, 1.0)
    for axis in range(3):
        e = vector(g, 6 + 3 * axis) if axis < 2 else cross(vector(g, 6), vector(g, 9))
        o = dot(away, e)
        reach = abs(o) / g[3 + axis]
        if reach > best:
            best = reach
            sign = 1.0 if o > 0.0 else -1.0
            normal = (sign * e[0], sign * e[1], sign * e[2])
    return normal


@compiled
def meet(world: SceneArrays, origin: Vector, direction: Vector, limit: float) -> tuple[float, int]:
    """Distance to the nearest shape closer than the limit, and which; -1 if none is."""
    nearest, shape = limit, -1
    for i in range(world.kind.size):
        g = world.geometry[i]
        kind = world.kind[i]
        if kind == PLANE:
            t = meet_plane(g, origin, direction)
        elif kind == SPHERE:
            t = meet_sphere(g, origin, direction)
        elif kind == RECTANGLE:
            t = meet_rectangle(g, origin, direction)
        else:
            t = meet_box(g, origin, direction)
        if t < nearest:
            nearest, shape = t, i
    return nearest, shape


@compiled
def outward(world: SceneArrays, shape: int, point: Vector) -> Vector:
    """Unit normal of the shape at the point: out of solids, along edge u x edge v of rectangles."""
    g = world.geometry[shape]
    kind = world.kind[shape]
    if kind == PLANE:
        return vector(g, 3)
    if kind == SPHERE:
        return unit(along(point, -1.0, vector(g, 0)))
    if kind == RECTANGLE:
        return unit(cross(vector(g, 3), vector(g, 6)))
    return box_normal(g, point)


@compiled
def colour_at(world: SceneArrays, shape: int, point: Vector) -> Vector:
    """Diffuse albedo at the point: the material's, times the texel of a textured rectangle."""
    albedo = vector(world.albedo[shape], 0)
    first, rows, columns, textured = world.texture[shape]
    if textured == 0 or world.kind[shape] != RECTANGLE:
        return albedo
    a, b = place_on_rectangle(world.geometry[shape], point)
    row = min(max(int(b * rows), 0), rows - 1)
    column = min(max(int(a * columns), 0), columns - 1)
    return times(albedo, vector(world.texels[first + row * columns + column], 0))
