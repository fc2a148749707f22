"""Focus: the sharpness of one photograph after the other, and the top of a sweep."""
