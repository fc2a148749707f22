"""Commands for a bench: show its devices, simulate it, serve it."""
