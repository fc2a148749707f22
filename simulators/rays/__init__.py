"""A small path tracer: Monte Carlo samples of scenes in depth."""
