"""What is drawn of a field beside its maps: curves over image height."""
