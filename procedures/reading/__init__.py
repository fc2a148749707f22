"""Foreign files become plain data: one module per format, all behind one guard. Photographs: `procedures.raw`."""
