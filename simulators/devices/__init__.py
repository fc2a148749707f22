"""Devices at byte level: what is on the other end of a simulated cable."""
