"""The complete bench: one world, its devices, a camera body that writes RAW files, an operator model, and faults."""
