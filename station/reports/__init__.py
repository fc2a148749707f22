"""Pages for people: one report and its figures for each procedure."""
