"""Shared utilities: safe names, uncertainty as text, atomic files, TOML, progress, stop signals, errors."""
