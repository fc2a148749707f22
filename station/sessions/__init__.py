"""Sessions: human-readable folders with append-only journals."""
