"""What the operator sees and keeps: the command line, the simulated demonstration, files and reports.

May import everything below it; nothing imports `station`. A new command is one file in `station/cli`
and one line in `station/__main__.py`.
"""
