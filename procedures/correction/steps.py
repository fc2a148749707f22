"""Pointwise steps of the splitting, each one pass over the samples; the tile is periodic."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from procedures.numerics.compiled import vectorised

Single = npt.NDArray[np.float32]
Spectrum = npt.NDArray[np.complex64]


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


def agree(copies: Single, z: Single, weight: Single, dual: Single, rho: np.float32) -> None:
    """Update the copies of the blurred planes by the data: reflected at their targets, and their duals."""
    _agree(copies.reshape(-1), z.reshape(-1), weight.reshape(-1), dual.reshape(-1), rho)


def shrink(d: Single, dual: Single, threshold: np.float32) -> None:
    """Soft-threshold the copies of the differences (K, C, n, n) by their common length; in place as `agree`."""
    flat = (d.shape[0] * d.shape[1], -1)
    _shrink(d.reshape(flat), dual.reshape(flat), threshold)


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
        for a in range(u.shape[0]):
            total = np.float32(0)
            for b in range(u.shape[0]):
                total += M[a, b] * u[b, i]
            out[a, i] = total


@vectorised
def _agree(copies: Single, z: Single, weight: Single, dual: Single, rho: np.float32) -> None:
    for i in range(copies.size):
        q = copies[i] - dual[i]
        # a negative weight marks a clipped sample, whose value is a lower bound
        v = max(q, z[i]) if weight[i] < 0 else (weight[i] * z[i] + rho * q) / (weight[i] + rho)
        dual[i] = v - q
        copies[i] = v + v - q


@vectorised
def _shrink(d: Single, dual: Single, threshold: np.float32) -> None:
    for i in range(d.shape[1]):
        square = np.float32(0)
        for k in range(d.shape[0]):
            d[k, i] -= dual[k, i]
            square += d[k, i] * d[k, i]
        size = np.sqrt(square)
        kept = (size - threshold) / size if size > threshold else np.float32(0)
        for k in range(d.shape[0]):
            q = d[k, i]
            y = kept * q
            dual[k, i] = y - q
            d[k, i] = y + y - q


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
    P, C = copies.shape[0], pulled.shape[0]
    for f in range(coupled.size):
        re, im = 2 * f, 2 * f + 1
        for c in range(C):
            out[c, re] = penalty * pulled[c, re]
            out[c, im] = penalty * pulled[c, im]
        for p in range(P):
            c = channel[p]
            a, b, x, y = conjugate[p, re], conjugate[p, im], copies[p, re], copies[p, im]
            out[c, re] += data * (a * x - b * y)
            out[c, im] += data * (a * y + b * x)
        real, imaginary = np.float32(0), np.float32(0)
        for c in range(C):
            out[c, re] *= inverse[c, f]
            out[c, im] *= inverse[c, f]
            real += out[c, re]
            imaginary += out[c, im]
        for c in range(C):
            out[c, re] += coupled[f] * real * inverse[c, f]
            out[c, im] += coupled[f] * imaginary * inverse[c, f]
