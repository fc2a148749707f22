"""From files to results, for the commands, the guide and the batch alike: one entry per procedure."""
