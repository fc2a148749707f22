"""Pairs of curves that the frame around a flat part contradicts weakly and strongly."""

import numpy as np

from procedures.restoration.unknown_motion.cross_relation import Disagreement
from procedures.restoration.unknown_motion.mask_evidence import MaskEvidence
from procedures.restoration.unknown_motion.motion_splines import POINTS
from procedures.restoration.unknown_motion.path_pairs import Search, distinct

from ..motions import BOX, FLAT_W, curves, photographs

FLAT = (slice(BOX[1], BOX[1] + BOX[3]), slice(BOX[0], BOX[0] + BOX[2]))


def around(slope):
    z = np.stack(photographs(slope))[:, 0]
    w = FLAT_W + slope * np.clip(np.arange(z.shape[2]) - 75.0, 0, None)
    return Disagreement(z / (z.std() / 100), FLAT, FLAT_W, np.broadcast_to(w, z.shape[1:]))


def contradiction(disagreement, points):
    return disagreement.of(*(disagreement.spectra(one) for one in points))


def test_true_curves_leave_noise_where_depth_is_constant():
    # 1, plus the effect of the whitening from beyond the frame
    assert 0.6 < contradiction(around(0.0), curves()) < 2


def test_wrong_curves_are_contradicted_and_descent_approaches_the_truth():
    bend = np.exp(-(((np.arange(POINTS) - 8) / 2.0) ** 2))[:, None]
    wrong = curves() + bend * np.array([[[0.4, -0.3]], [[-0.3, 0.4]]])
    one = MaskEvidence.about(curves(), FLAT_W, FLAT_W, 5)
    one.add(np.eye(one.masks.size), np.zeros(one.masks.size), 1e6)
    flat = [one]
    sloping = around(0.01)
    assert contradiction(sloping, wrong) > 2 * contradiction(sloping, curves())
    z = np.stack(photographs())[:, 0]
    nothing = Disagreement(z, (slice(None), slice(None)), FLAT_W, np.full(z.shape[1:], FLAT_W))
    assert contradiction(nothing, wrong) == 0
    assert nothing.evidence(wrong) == []
    pairs = Search(sloping, flat).descend(wrong)
    true = contradiction(sloping, curves())
    assert pairs.disagreement - true < 0.3 * (contradiction(sloping, wrong) - true)
    search = Search(sloping, flat)
    pools = [[wrong[0], curves()[0]], [curves()[1]]]
    pairs = search.starts([distinct(flat, curves(), FLAT_W, k, pool) for k, pool in enumerate(pools)])
    contradictions = [pair.disagreement for pair in pairs]
    assert contradictions == sorted(contradictions)
    # where both converge to the same masks, one of them is dropped
    assert 1 <= len(pairs) <= 2
    assert contradictions[0] < 0.5 * contradiction(sloping, wrong)
