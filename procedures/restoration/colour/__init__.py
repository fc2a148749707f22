"""Colour on the sensor's own grid: the picture at every pixel from mosaics whose planes lie apart, given their depth.

Over the joint restoration, which finds w from the planes as they are: each has a picture of its own there, so it does
not matter that they lie apart. Here they share one picture, seen by every plane at its own places.
"""
