"""From files to results: one entry per procedure, for commands, guide and batch alike."""
