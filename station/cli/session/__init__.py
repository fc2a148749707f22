"""`station session ...`, one file a command."""
