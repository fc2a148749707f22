"""The pose of an edge in a preview: as it is, and as it is wanted."""

import numpy as np

from procedures.numerics.arrays import Array, Array32
from procedures.outcome import Refused
from procedures.plan import Advice, Outline, Points
from procedures.raw import RawFrame
from procedures.slanted_edge.find import EdgeSighting, find_edges, longest_segment

SLANT_DEG, SHARE = 5.0, 0.5
"""Slant from the nearest axis at which an edge is wanted; its length over the frame's height without one."""


def check_edge(frame: RawFrame) -> Advice:
    """Accept a slanted edge between plain areas; otherwise show where one is wanted, with the reason."""
    samples = frame.guide.samples
    try:
        ends = ends_of(find_edges(samples)[0])
    except Refused as refusal:
        say = f"{refusal.reason[:1].upper()}{refusal.reason[1:]}: {refusal.remedy}."
        return Advice(False, say, by_hand={"edge": 1.0}, outline=edge_outline(samples, longest_segment(samples)))
    return Advice(True, "A slanted edge is in the frame.", outline=Outline(ends, ends))


def ends_of(edge: EdgeSighting) -> Points:
    """Both ends of an edge in the plane."""
    roi, half = edge.strip.roi, (len(edge.strip.samples) - 1) / 2

    def point(along: float) -> tuple[float, float]:
        across = edge.line.middle + edge.line.slope * (along - half)
        return (roi.x + along, roi.y + across) if edge.strip.turned else (roi.x + across, roi.y + along)

    return point(0.0), point(2 * half)


def edge_outline(samples: Array32, segment: Array | None) -> Outline:
    """The longest straight segment (2, 2) and the same turned to a good slant; upright in the middle without one."""
    rows, columns = samples.shape
    middle, length, along = np.array([columns - 1, rows - 1]) / 2, SHARE * rows, np.array([0.0, 1.0])
    if segment is not None:
        middle, length = segment.mean(axis=0), float(np.hypot(*(segment[1] - segment[0])))
        along = (segment[1] - segment[0]) / length
    axis = np.sign(along) * (np.arange(2) == np.abs(along).argmax())
    turn = np.radians(SLANT_DEG) * (1 if axis[0] * along[1] - axis[1] * along[0] >= 0 else -1)
    wanted = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ axis * length / 2
    return Outline(() if segment is None else _points(segment), _points(np.array([middle - wanted, middle + wanted])))


def _points(ends: Array) -> Points:
    return tuple((float(x), float(y)) for x, y in ends)
