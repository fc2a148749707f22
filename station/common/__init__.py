"""What every room needs: names made safe, uncertainty as text, files that are whole, TOML, progress, stop signals, errors."""
