"""What is at the ends of the cables: protocol, timing and state of each device, byte by byte."""
