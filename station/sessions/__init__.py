"""Sessions: folders that a person can read, with journals that lose nothing."""
