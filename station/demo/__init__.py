"""What needs simulators and known truth: the demonstration, the papers' tables, rendered scenes."""
