"""Plans whose estimates put files and photographs together as the commands do."""
