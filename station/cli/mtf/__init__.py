"""`station mtf ...`, one file a command."""
