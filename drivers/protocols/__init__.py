"""Device protocols, encoded and decoded without opening a port."""
