"""What files say, format by format: grey pictures, sensor dumps, TIFF tags, exposures. `procedures.raw` is the door."""
