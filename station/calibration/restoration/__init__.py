"""Restorations as commands, sessions and batches ask for them: options, files, outcome."""
