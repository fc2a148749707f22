"""Algorithm I: picture and depth together, from a first depth to the pair of least cost (6.1)."""
