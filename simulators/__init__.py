"""The same bench without the bench: scene -> optics -> sensor -> DNG.

Renders from continuous formulas and reads nothing of the procedures but the chart's geometry, so that the
agreement of estimate and truth is evidence.
"""
