"""Pages for people: one report and its figures per procedure."""
