"""The operator's application (Textual): what it can do, the command line can do without it."""
