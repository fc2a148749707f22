"""From files to results, for commands, guide and batch alike: one entry for each procedure."""
