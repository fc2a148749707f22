"""Nodes sampled alike: supports of different widths are widened to the widest, by what their tails say lies there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from procedures.numerics.kernel_tail import SHAPES, tail_border, tail_kernels
from procedures.outcome import Refused
from procedures.psf import Psf
from procedures.psf_field import Node

Array = npt.NDArray[np.float64]


def alike(nodes: Sequence[Node]) -> tuple[Node, ...]:
    """The nodes with PSFs of one size, the widest support's.

    Raises
    ------
    Refused
        If they have different numbers of samples per pixel, or shapes of the tail, or different supports without one.
    """
    first = nodes[0]
    for node in nodes[1:]:
        if node.psf.s != first.psf.s:
            raise Refused(
                f"the PSFs of a field must have the same samples per pixel; {_name(first)} has s = {first.psf.s}, "
                f"{_name(node)} has s = {node.psf.s}",
                "measure all photographs with one s: give it with -s",
            )
        if len(node.psf.tail.amplitudes) != len(first.psf.tail.amplitudes):
            raise Refused(
                f"the PSFs of a field must all say what lies outside their supports, or none; {_name(first)} has "
                f"{_shapes(first)} and {_name(node)} has {_shapes(node)}",
                "measure all photographs with this version",
            )
    k = max(node.psf.k for node in nodes)
    return tuple(node if node.psf.k == k else replace(node, psf=_widened_node(node, k)) for node in nodes)


def widened(psf: Psf, k: int) -> Psf:
    """A PSF with a tail on a wider support of k x k samples: those outside its own are the tail's, of no own error.

    What it says of the light stays the same, but for the turning shapes beyond their reach, which hardly differs.
    """
    n, q = psf.k**2, len(psf.tail.amplitudes)
    if k < psf.k or k % 2 == 0 or not q:
        raise ValueError(f"a support of {psf.k} samples with a tail can be widened; asked for {k}, {q} shapes")
    narrow, wide = tail_kernels(psf.k)[:q], tail_kernels(k)[:q]
    M = np.zeros((k * k + q, n + q))
    inner = np.pad(np.arange(n).reshape(psf.k, psf.k) + 1, (k - psf.k) // 2).ravel()
    M[np.flatnonzero(inner), inner[inner > 0] - 1] = 1
    low = tail_border(psf.k) - k // 2
    M[: k * k, n:] = narrow[:, low : low + k, low : low + k].reshape(q, -1).T
    M[k * k :, n:] = np.diag(_rescale(narrow, wide, k))
    p = M @ psf.parameters
    total = p[: k * k].sum()
    inside = np.concatenate([np.ones(k * k), np.zeros(q)])
    J = (M - np.outer(p / total, inside @ M)) / total
    return Psf.of(p / total, J @ psf.parameter_covariance @ J.T, k, psf.s)


def _rescale(narrow: Array, wide: Array, k: int) -> Array:
    """Amplitudes (q,) of the wide support's shapes that are one of the narrow one's: the shapes turning with the
    direction go with the mean."""
    beyond = k // 2 + 1
    ratio = np.array([a[len(a) // 2, len(a) // 2 + beyond] / b[len(b) // 2, len(b) // 2 + beyond]
                      for a, b in zip(narrow[:2], wide[:2], strict=True)])  # fmt: skip
    return np.array([ratio[j] if SHAPES[j].startswith("1/") else ratio[0] for j in range(len(narrow))])


def _widened_node(node: Node, k: int) -> Psf:
    if not len(node.psf.tail.amplitudes):
        raise Refused(
            f"the PSFs of a field must have supports of one size where they have no tail; {_name(node)} has k = "
            f"{node.psf.k}, another k = {k}",
            "measure all photographs with one k: give it with -k",
        )
    return widened(node.psf, k)


def _name(node: Node) -> str:
    return f"chart {node.number} of {node.source}" if node.source else f"chart {node.number}"


def _shapes(node: Node) -> str:
    count = len(node.psf.tail.amplitudes)
    return f"{count} shapes of a tail" if count else "no tail"
