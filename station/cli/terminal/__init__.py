"""Common parts of commands: columns, progress, and groups that import a command when it is called."""
