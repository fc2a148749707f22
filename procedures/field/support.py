"""Nodes of one sampling: narrower supports are extended to the widest one by their tails."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from procedures.numerics.arrays import Array
from procedures.numerics.kernel_tail import SHAPES, tail_border, tail_kernels
from procedures.outcome import Refused
from procedures.psf import Psf
from procedures.psf_field import Node


def with_common_support(nodes: Sequence[Node]) -> tuple[Node, ...]:
    """The nodes with PSFs of one size, that of the widest support.

    Raises Refused if their samples per pixel or their tails' shapes differ, or their supports differ and they have no
    tail.
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
                f"the PSFs of a field must all have the same tail, or none; {_name(first)} has {_shapes(first)} and "
                f"{_name(node)} has {_shapes(node)}",
                "measure all photographs with this version",
            )
    k = max(node.psf.k for node in nodes)
    narrow = next((node for node in nodes if node.psf.k < k and not len(node.psf.tail.amplitudes)), None)
    if narrow is not None:
        raise Refused(
            f"the PSFs of a field must have supports of one size where they have no tail; {_name(narrow)} has k = "
            f"{narrow.psf.k}, another k = {k}",
            "measure all photographs with one k: give it with -k",
        )
    return tuple(node if node.psf.k == k else replace(node, psf=widened(node.psf, k)) for node in nodes)


def widened(psf: Psf, k: int) -> Psf:
    """A PSF with a tail on a wider support of k x k samples: the added samples are those of the tail, without error of
    their own.

    The PSF is unchanged, except for a small difference of the azimuthal shapes beyond their reach.
    """
    n, q = psf.k**2, len(psf.tail.amplitudes)
    if k < psf.k or k % 2 == 0 or not q:
        raise ValueError(
            f"the new support must be odd and at least {psf.k}, and the PSF have a tail; got {k}, {q} shapes"
        )
    narrow, wide = tail_kernels(psf.k)[:q], tail_kernels(k)[:q]
    M = np.zeros((k * k + q, n + q))
    inner = np.pad(np.arange(n).reshape(psf.k, psf.k) + 1, (k - psf.k) // 2).ravel()
    M[np.flatnonzero(inner), inner[inner > 0] - 1] = 1
    low = tail_border(psf.k) - k // 2
    M[: k * k, n:] = narrow[:, low : low + k, low : low + k].reshape(q, -1).T
    M[k * k :, n:] = np.diag(_rescaling(narrow, wide, k))
    return Psf.of_unit_sum(M @ psf.parameters, M @ psf.parameter_covariance @ M.T, k, psf.s)


def _rescaling(narrow: Array, wide: Array, k: int) -> Array:
    """Amplitudes (q,) of the wide support's shapes equal to those of the narrow one; azimuthal shapes as the mean."""
    beyond = k // 2 + 1
    ratio = np.array([a[len(a) // 2, len(a) // 2 + beyond] / b[len(b) // 2, len(b) // 2 + beyond]
                      for a, b in zip(narrow[:2], wide[:2], strict=True)])  # fmt: skip
    return np.array([ratio[j] if SHAPES[j].startswith("1/") else ratio[0] for j in range(len(narrow))])


def _name(node: Node) -> str:
    return f"chart {node.number} of {node.source}" if node.source else f"chart {node.number}"


def _shapes(node: Node) -> str:
    count = len(node.psf.tail.amplitudes)
    return f"{count} tail shapes" if count else "no tail"
