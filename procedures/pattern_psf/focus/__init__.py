"""Focus: sharpness of single photographs, best focus of a sweep, and plausibility of the f-number."""
