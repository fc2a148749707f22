"""The page of slanted edges and its figures."""
