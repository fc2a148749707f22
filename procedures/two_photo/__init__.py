"""PSF from two photographs of one textured wall at different distances.

Contains the registration of the two photographs, the kernel between them, the recursion from it to the camera's PSF,
checks of their consistency, and the verdict. May import no other estimator.
"""
