"""The commands, one file each, loaded when called: they parse, delegate, and write the result."""
