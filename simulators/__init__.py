"""Simulated bench: scene -> optics -> sensor -> DNG.

Renders from continuous formulas and reads nothing of the procedures but the chart's geometry, so that the
agreement of estimate and truth is evidence. `camera.SimulatedCamera` is the main class: it places charts, takes
photographs of a `scene.Scene` and knows the truth about them. A new cause of blur is a class with the two methods
of `optics.Blur`; a new thing to look at yields `scene.Stroke`s.
"""
