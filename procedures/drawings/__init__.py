"""ASCII drawings of the steps of plans."""
