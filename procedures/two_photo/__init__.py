"""PSF from two photographs of one textured wall at different distances.

Lives here: matching of the two photographs, the kernel between them, the recursion that makes the camera's PSF of it,
what tells that they are not alike, and the verdict. May import `psf`, `quality`, `choice`, `budget`, `sharpening`,
`clipping`, `raw`, `outcome` and `numerics`, no other room.
"""
