"""Readers of foreign files: one module per format, all with the limits of `guard`. Photographs: `procedures.raw`."""
