"""Restoration of one sharp picture and the depth map from two or more depth-dependently blurred photographs (Sorel
2007)."""
