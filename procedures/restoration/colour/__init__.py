"""Colour on the sensor's grid: the picture at every pixel from mosaics with displaced planes, given their depth.

The joint restoration before it estimates w from the planes separately, each with its own picture, so that their
displacement does not matter. Here they share one picture, which every plane samples at its own positions.
"""
