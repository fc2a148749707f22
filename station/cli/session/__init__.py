"""`station session ...`."""
