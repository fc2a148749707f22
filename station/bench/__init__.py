"""station.toml becomes open devices; the one door to simulated benches."""
