"""Live focus: sharpness of photographs as they arrive."""
