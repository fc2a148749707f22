"""A line in use: bytes on their way out, what passed, and whether the other end is there."""
