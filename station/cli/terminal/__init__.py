"""What the commands share: columns, progress, and groups that import a command when it is called."""
