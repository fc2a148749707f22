"""`station mtf ...`."""
