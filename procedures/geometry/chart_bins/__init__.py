"""Positions of a chart's cells in a photograph, averaged over bins of the chart, with covariance."""
