"""Applications of simulators with known truth: the demonstration, the papers' tables, rendered scenes."""
