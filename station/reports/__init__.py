"""The pages: one report and its figures per procedure."""
