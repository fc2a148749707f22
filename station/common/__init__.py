"""What every room needs: safe names, uncertainty as text, whole files, TOML, progress, stop signals, errors."""
