"""The commands, one file each, loaded only when called: they parse, delegate, and write what came back."""
