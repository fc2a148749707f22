"""A line in use: outgoing bytes, the transcript, and the connection state."""
