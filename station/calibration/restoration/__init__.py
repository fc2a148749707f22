"""Restorations for commands, sessions and batches: options, files, outcome."""
