"""Focus: the sharpness of one photograph after the other, the top of a sweep, and whether the f-number can be true."""
