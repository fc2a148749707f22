"""What is on the other end of a wire: one device per file, behind small interfaces.

Knows neither the procedures nor the simulators that stand in for its devices.
"""
