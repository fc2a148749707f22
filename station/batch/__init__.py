"""Many photographs without a terminal, shared out to processes or to a cluster."""
