"""Simulated devices: protocol, timing and state of each, byte by byte."""
