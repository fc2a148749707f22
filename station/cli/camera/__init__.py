"""What a camera is beside its PSF: geometry, sensor, vignetting, and how its sensor stands; one file a command."""
