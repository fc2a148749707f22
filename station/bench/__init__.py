"""Opens the devices configured in station.toml, real or simulated."""
