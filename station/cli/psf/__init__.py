"""`station psf ...`, one file a command."""
