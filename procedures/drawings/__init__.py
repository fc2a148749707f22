"""What to do at the steps of plans, drawn in characters."""
