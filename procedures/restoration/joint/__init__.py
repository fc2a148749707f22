"""Algorithm I: joint estimation of picture and depth, from a first depth to the pair of minimal cost (6.1)."""
