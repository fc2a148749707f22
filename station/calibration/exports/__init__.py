"""Files for other programs, from results."""
