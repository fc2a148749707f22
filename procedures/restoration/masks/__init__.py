"""Blur masks as functions of depth, from lens, motion or measurement, and the space-variant blur operator."""
