"""Pointwise steps of the splitting, each one pass over the samples; the tile is periodic."""

import numpy as np
import numpy.typing as npt

from procedures.numerics.compiled import vectorised

Single = npt.NDArray[np.float32]
Spectrum = npt.NDArray[np.complex64]

BLOCK = 512
"""Samples of a row that are processed together: inner loops of one operation are vectorised."""
RELAXED = np.float32(1.8)
"""Over-relaxation of the copies, between 1 and 2 (Eckstein and Bertsekas 1992)."""
TINY = np.float32(1e-30)
"""Smallest square of a length."""
LEAST_SLOPE = np.float32(1e-12)
"""Added to a slope, so that its direction is known."""


def mixed(M: Single, u: Single) -> Single:
    """Channels (C, n, n) times a matrix (C, C)."""
    if len(M) == 1:
        return u
    out = np.empty_like(u)
    _mix(M, u.reshape(len(u), -1), out.reshape(len(u), -1))
    return out


def differences(x: Single, second: bool) -> Single:
    """Differences of each channel (C, n, n) down and across; or second ones down, across and sqrt(2) mixed."""
    out = np.empty((3 if second else 2, *x.shape), dtype=np.float32)
    (_second if second else _first)(x, out)
    return out


def divergence(d: Single, second: bool) -> Single:
    """The adjoint of `differences`, (C, n, n)."""
    out = np.empty(d.shape[1:], dtype=np.float32)
    (_second_adjoint if second else _first_adjoint)(d, out)
    return out


def length(d: Single) -> Single:
    """Length over kinds and channels of differences (K, C, n, n), (n, n)."""
    return np.asarray(np.sqrt(np.sum(d**2, axis=(0, 1))))


def agree(copies: Single, before: Single, z: Single, weight: Single, dual: Single, rho: np.float32) -> None:
    """Update the copies of the blurred planes by the data: reflected at their targets, and their duals.

    before : the copies of the last iteration as this function left them, for over-relaxation
    """
    _agree(copies.reshape(-1), before.reshape(-1), z.reshape(-1), weight.reshape(-1), dual.reshape(-1), rho)


def shrink(d: Single, dual: Single, threshold: np.float32, slopes: Single | None) -> None:
    """Soft-threshold the copies of the differences (K, C, n, n) by their common length; in place as `agree`.

    slopes : (2, n, n), or None for one colour: the length is |(l, c - k l)| for slopes k of the differences of colour c
    over those of lightness l. This matrix has the singular values 1 / t, t and 1, t = (|k| + sqrt(|k|^2 + 4)) / 2, with
    the vectors (1, t k / |k|), (-t, k / |k|), and what is orthogonal to both. The root of the secular equation is the
    first step of Newton's method, exact for k = 0 (More, Sorensen, SIAM J. Sci. Stat. Comput. 4 (1983), section 3).
    """
    if slopes is None:
        _shrink(d.reshape(d.shape[0], -1), dual.reshape(d.shape[0], -1), threshold)
    else:
        flat = (d.shape[0], 3, -1)
        _shrink_colours(d.reshape(flat), dual.reshape(flat), slopes.reshape(2, -1), threshold)


def solve(
    copies: Spectrum, conjugate: Spectrum, channel: npt.NDArray[np.int64], pulled: Spectrum, inverse: Single,
    coupled: Single, data: np.float32, penalty: np.float32, out: Spectrum,
) -> None:  # fmt: skip
    """The normal equations at every frequency: (1 / inverse - c) out = data sum conj(H) copies + penalty pulled."""
    P, C = len(copies), len(pulled)
    _solve(
        copies.view(np.float32).reshape(P, -1), conjugate.view(np.float32).reshape(P, -1), channel,
        pulled.view(np.float32).reshape(C, -1), inverse.reshape(C, -1), coupled.reshape(-1), data, penalty,
        out.view(np.float32).reshape(C, -1),
    )  # fmt: skip


@vectorised
def _mix(M: Single, u: Single, out: Single) -> None:
    for i in range(u.shape[1]):
        x, y, z = u[0, i], u[1, i], u[2, i]
        for a in range(3):
            out[a, i] = M[a, 0] * x + M[a, 1] * y + M[a, 2] * z


@vectorised
def _agree(copies: Single, before: Single, z: Single, weight: Single, dual: Single, rho: np.float32) -> None:
    for i in range(copies.size):
        q = RELAXED * copies[i] + (np.float32(1) - RELAXED) * (before[i] - dual[i]) - dual[i]
        # a negative weight marks a clipped sample, whose value is a lower bound
        v = max(q, z[i]) if weight[i] < 0 else (weight[i] * z[i] + rho * q) / (weight[i] + rho)
        dual[i] = v - q
        copies[i] = v + v - q


@vectorised
def _shrink(d: Single, dual: Single, threshold: np.float32) -> None:
    kept = np.empty(BLOCK, np.float32)
    for start in range(0, d.shape[1], BLOCK):
        count = min(BLOCK, d.shape[1] - start)
        kept[:] = np.float32(0)
        for k in range(d.shape[0]):
            x, m = d[k, start : start + count], dual[k, start : start + count]
            for i in range(count):
                x[i] -= m[i]
                kept[i] += x[i] * x[i]
        for i in range(count):
            kept[i] = max(np.float32(1) - threshold / np.sqrt(kept[i] + TINY), np.float32(0))
        for k in range(d.shape[0]):
            x, m = d[k, start : start + count], dual[k, start : start + count]
            for i in range(count):
                y = kept[i] * x[i]
                m[i] = y - x[i]
                x[i] = y + m[i]


@vectorised
def _shrink_colours(d: Single, dual: Single, slopes: Single, threshold: np.float32) -> None:
    one, zero = np.float32(1), np.float32(0)
    u, v, t, scale = np.empty((4, BLOCK), np.float32)
    a, b, c = np.empty((3, BLOCK), np.float32)
    p, q, o = np.empty((3, BLOCK), np.float32)
    for start in range(0, d.shape[2], BLOCK):
        count = min(BLOCK, d.shape[2] - start)
        part = slice(start, start + count)
        first, second = slopes[0, part], slopes[1, part]
        for i in range(count):
            x0 = first[i] + LEAST_SLOPE  # a slope of 0 has a direction too
            k = np.sqrt(x0 * x0 + second[i] * second[i])
            t[i] = np.float32(0.5) * (k + np.sqrt(k * k + np.float32(4)))
            u[i], v[i] = x0 / k, second[i] / k
        for i in range(count):
            scale[i] = one / (one + t[i] * t[i])
        a[:], b[:], c[:] = zero, zero, zero
        for kind in range(d.shape[0]):
            for channel in range(3):
                x, m = d[kind, channel, part], dual[kind, channel, part]
                for i in range(count):
                    x[i] -= m[i]
            x, y, z = d[kind, 0, part], d[kind, 1, part], d[kind, 2, part]
            for i in range(count):
                p[i] = u[i] * y[i] + v[i] * z[i]
                across = u[i] * z[i] - v[i] * y[i]
                c[i] += across * across
            for i in range(count):
                along, against = x[i] + t[i] * p[i], p[i] - t[i] * x[i]
                a[i] += scale[i] * along * along
                b[i] += scale[i] * against * against
        for i in range(count):
            high = t[i] * t[i]
            low = one / high
            square = high * a[i] + low * b[i] + c[i] + TINY
            cube = high * high * a[i] + low * low * b[i] + c[i] + TINY
            kept = max((np.sqrt(square) / threshold - one) * square / cube, zero)
            a[i] = kept / (kept + low) * scale[i]
            b[i] = kept / (kept + high) * scale[i]
            c[i] = kept / (kept + one)
        for kind in range(d.shape[0]):
            x, y, z = d[kind, 0, part], d[kind, 1, part], d[kind, 2, part]
            for i in range(count):
                p[i] = u[i] * y[i] + v[i] * z[i]
                o[i] = c[i] * (u[i] * z[i] - v[i] * y[i])
            for i in range(count):
                along, against = a[i] * (x[i] + t[i] * p[i]), b[i] * (p[i] - t[i] * x[i])
                q[i] = along - t[i] * against
                p[i] = t[i] * along + against
            _reflect(x, dual[kind, 0, part], q)
            for i in range(count):
                q[i] = u[i] * p[i] - v[i] * o[i]
                p[i] = v[i] * p[i] + u[i] * o[i]
            _reflect(y, dual[kind, 1, part], q)
            _reflect(z, dual[kind, 2, part], p)


@vectorised
def _reflect(x: Single, dual: Single, kept: Single) -> None:
    """Update the dual of x by what is kept of it, and reflect x at it."""
    for i in range(x.size):
        dual[i] = kept[i] - x[i]
        x[i] = kept[i] + dual[i]


@vectorised
def _first(x: Single, out: Single) -> None:
    C, n, m = x.shape
    for c in range(C):
        for i in range(n):
            row, below = x[c, i], x[c, (i + 1) % n]
            for j in range(m):
                out[0, c, i, j] = below[j] - row[j]
            for j in range(m - 1):
                out[1, c, i, j] = row[j + 1] - row[j]
            out[1, c, i, m - 1] = row[0] - row[m - 1]


@vectorised
def _first_adjoint(d: Single, out: Single) -> None:
    C, n, m = out.shape
    for c in range(C):
        for i in range(n):
            here, above, across, to = d[0, c, i], d[0, c, (i + n - 1) % n], d[1, c, i], out[c, i]
            for j in range(m):
                to[j] = above[j] - here[j]
            for j in range(1, m):
                to[j] += across[j - 1] - across[j]
            to[0] += across[m - 1] - across[0]


@vectorised
def _second(x: Single, out: Single) -> None:
    C, n, m = x.shape
    root = np.float32(2**0.5)
    for c in range(C):
        for i in range(n):
            row, below, above = x[c, i], x[c, (i + 1) % n], x[c, (i + n - 1) % n]
            for j in range(m):
                right, left = (j + 1) % m, (j + m - 1) % m
                out[0, c, i, j] = below[j] - 2 * row[j] + above[j]
                out[1, c, i, j] = row[right] - 2 * row[j] + row[left]
                out[2, c, i, j] = root * (below[right] - below[j] - row[right] + row[j])


@vectorised
def _second_adjoint(d: Single, out: Single) -> None:
    C, n, m = out.shape
    root = np.float32(2**0.5)
    for c in range(C):
        for i in range(n):
            up, down = (i + n - 1) % n, (i + 1) % n
            for j in range(m):
                left, right = (j + m - 1) % m, (j + 1) % m
                total = d[0, c, up, j] - 2 * d[0, c, i, j] + d[0, c, down, j]
                total += d[1, c, i, left] - 2 * d[1, c, i, j] + d[1, c, i, right]
                cross = d[2, c, up, left] - d[2, c, up, j] - d[2, c, i, left] + d[2, c, i, j]
                out[c, i, j] = total + root * cross


@vectorised
def _solve(
    copies: Single, conjugate: Single, channel: npt.NDArray[np.int64], pulled: Single, inverse: Single,
    coupled: Single, data: np.float32, penalty: np.float32, out: Single,
) -> None:  # fmt: skip
    re, im = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    for start in range(0, coupled.size, BLOCK):
        count = min(BLOCK, coupled.size - start)
        part = slice(2 * start, 2 * (start + count))
        for c in range(pulled.shape[0]):
            o, t = out[c, part], pulled[c, part]
            for i in range(2 * count):
                o[i] = penalty * t[i]
        for p in range(copies.shape[0]):
            o, h, z = out[channel[p], part], conjugate[p, part], copies[p, part]
            for i in range(count):
                a, b, x, y = h[2 * i], h[2 * i + 1], z[2 * i], z[2 * i + 1]
                o[2 * i] += data * (a * x - b * y)
                o[2 * i + 1] += data * (a * y + b * x)
        re[:] = np.float32(0)
        im[:] = np.float32(0)
        for c in range(pulled.shape[0]):
            o, w = out[c, part], inverse[c, start : start + count]
            for i in range(count):
                o[2 * i] *= w[i]
                o[2 * i + 1] *= w[i]
                re[i] += o[2 * i]
                im[i] += o[2 * i + 1]
        for c in range(pulled.shape[0]):
            o, w, much = out[c, part], inverse[c, start : start + count], coupled[start : start + count]
            for i in range(count):
                o[2 * i] += much[i] * re[i] * w[i]
                o[2 * i + 1] += much[i] * im[i] * w[i]
