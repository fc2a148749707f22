"""The PSF from one photograph of the Bernoulli noise chart: find, register, linearise, rasterise, solve, judge."""
