"""Files that other programs take, made from results."""
