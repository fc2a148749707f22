"""What is done with a bench from the command line: its devices shown, simulated for others, served to others."""
