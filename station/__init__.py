"""Command line, applications, files and reports for the operator. May import everything below it; nothing imports
`station`. A new command is one file in `station/cli` and one line in `station/__main__.py`."""
