"""Mathematics without cameras: transforms, resampling, warps, solvers. Imports nothing of the project."""
